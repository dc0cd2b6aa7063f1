"""Hand-made hostile files of every reader: exit code 2 and one line that names the file and the field, within 10 s.

No traceback, no control character, nothing written outside the folder, bounded memory. The cases are those of
`benchmarks/hostile`, each run through the command in a process of its own.
"""

import shutil
from pathlib import Path

import pytest

from hostile.cases import READ, WARM_UP
from hostile.corpus import corpus
from hostile.good import make_good
from hostile.running import warm_up
from hostile_inputs import check

pytestmark = pytest.mark.slow
ARM = Path(__file__).parents[1] / "data" / "ur5e.urdf"


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    folder = tmp_path_factory.mktemp("good")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{folder.parent / 'mlflow.db'}")
        make_good(folder, ARM)
        warm_up(folder, tmp_path_factory.mktemp("warm"), dict.fromkeys(WARM_UP))
    return folder


@pytest.mark.parametrize("reader", READ)
def test_hostile_files_are_refused_in_one_line(reader, good, tmp_path):
    cases = [case for case in corpus() if case.reader == reader]
    assert cases
    wrong = []
    for number, case in enumerate(cases):
        place = tmp_path / str(number)
        place.mkdir()
        if problem := check(case, good, place):
            wrong.append(f"{case.name}: {problem}")
        shutil.rmtree(place)
    assert not wrong, "\n".join(wrong)
