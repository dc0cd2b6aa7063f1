import pytest

import viewers


@pytest.fixture
def viewer(tmp_path):
    """(url, client) of a headless viewer; skips the test where nothing can draw."""
    with viewers.headless_viewer(tmp_path) as opened:
        yield opened
