"""Hand-made hostile files of every reader: exit code 2 and one line that names the file and the field, within 10 s.

No traceback, no control character, nothing written outside the folder, bounded memory. The cases are those of
`benchmarks/hostile`, each run through the command in a process of its own.
"""

import shutil

import pytest

from hostile.cases import READ, WARM_UP
from hostile.corpus import corpus
from hostile.running import warm_up
from hostile_inputs import check

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def warm(good, tmp_path_factory):
    """Good files whose commands have compiled what they need."""
    warm_up(good, tmp_path_factory.mktemp("warm"), dict.fromkeys(WARM_UP))
    return good


@pytest.mark.parametrize("reader", READ)
def test_hostile_files_are_refused_in_one_line(reader, warm, tmp_path):
    cases = [case for case in corpus() if case.reader == reader]
    assert cases
    wrong = []
    for number, case in enumerate(cases):
        place = tmp_path / str(number)
        place.mkdir()
        if problem := check(case, warm, place):
            wrong.append(f"{case.name}: {problem}")
        shutil.rmtree(place)
    assert not wrong, "\n".join(wrong)
