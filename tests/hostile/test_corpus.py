"""Hand-made hostile files of every reader: exit code 2 and one line that names the file and the field, within 10 s.

No traceback, no control character, nothing written outside the folder, bounded memory. The cases are those of
`benchmarks/hostile`, each run through the command in a process of its own.
"""

import pytest

from hostile.cases import READ, WARM_UP
from hostile.running import warm_up
from hostile_inputs import problems_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def warm(good, clean_process, tmp_path_factory):
    """Good files, in a process whose commands have compiled what they need."""
    clean_process(warm_up, good, tmp_path_factory.mktemp("warm"), tuple(dict.fromkeys(WARM_UP)))
    return good


@pytest.mark.parametrize("reader", READ)
def test_hostile_files_are_refused_in_one_line(reader, warm, clean_process, tmp_path):
    wrong = clean_process(problems_of, reader, warm, tmp_path)
    assert not wrong, "\n".join(wrong)
