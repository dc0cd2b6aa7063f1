"""Good files of every reader."""

from pathlib import Path

import pytest

from hostile.good import make_good

ARM = Path(__file__).parents[1] / "data" / "ur5e.urdf"


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A folder with good files of every reader; commands that log do so beside it."""
    folder = tmp_path_factory.mktemp("good")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{folder.parent / 'mlflow.db'}")
        make_good(folder, ARM)
        yield folder
