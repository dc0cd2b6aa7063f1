"""A real viewer of rerun without a screen."""

import contextlib
import subprocess
import time

import pytest
from rerun.experimental import ViewerClient

from cutgrammar_dashboards.recording.viewer import free_port, quiet_environment, viewer_binary


@contextlib.contextmanager
def headless_viewer(folder, port=None):
    """(url, client) of a viewer that logs into `folder`; skips the test where nothing can draw."""
    port, log = port or free_port(), folder / "viewer.log"
    url = f"rerun+http://127.0.0.1:{port}/proxy"
    words = [viewer_binary(), "--headless", "--bind", "127.0.0.1", "--port", str(port), "--window-size", "1600x1000"]
    with log.open("w") as out:
        process = subprocess.Popen(words, env=quiet_environment(), stdout=out, stderr=out)
    try:
        yield url, _connected(process, url, log)
    finally:
        process.kill()
        process.wait()


def views_with(client, wanted, seconds=30):
    """The views that the viewer shows, as soon as those named are among them; or after this time."""
    deadline, views = time.monotonic() + seconds, []
    while not wanted <= {view.name for view in views} and time.monotonic() < deadline:
        time.sleep(0.5)
        views = client.get_state().views
    return views


def _connected(process, url, log):
    for _ in range(60):
        if process.poll() is not None or "Failed to get render context" in log.read_text():
            pytest.skip("no graphics adapter that rerun can draw with on this machine")
        try:
            client = ViewerClient(url)
            client.get_state()
        except ConnectionError:
            time.sleep(0.5)
        else:
            return client
    raise AssertionError(f"the viewer did not start:\n{log.read_text()}")
