"""The stream to a viewer, which may be absent, killed or started again while a run works."""

import socket
import threading
import time
from urllib.parse import urlsplit

import rerun as rr

from cutgrammar_dashboards.recording.writer import APPLICATION

LOOK_SECONDS = 2.0
"""Time between two looks whether the viewer is there [s]."""
START_SECONDS = 20.0
"""How long a viewer that has just been started may take to be there [s]."""
FLUSH_SECONDS = 0.9
"""How long the end waits for each of: the viewer has everything, and the stream is closed [s]."""


class Connection:
    """A stream to the viewer at a URL while one listens there.

    Args:
        url: e.g. "rerun+http://127.0.0.1:9876/proxy".
        patient: wait for the viewer at first, which is being started.

    Attributes:
        stream: the stream; None while no viewer listens. Another viewer at the same address gets another stream.
    """

    def __init__(self, url: str, patient: bool) -> None:
        self._url = url
        parts = urlsplit(url)
        self._place = parts.hostname or "127.0.0.1", parts.port or 9876
        self.stream: rr.RecordingStream | None = None
        self._looked = 0.0
        deadline = time.monotonic() + (START_SECONDS if patient else 0.0)
        while not self._is_there() and time.monotonic() < deadline:
            time.sleep(0.2)

    def renewed(self) -> bool:
        """Look, if it is time to, whether the viewer is there; returns whether there is another stream than before."""
        if time.monotonic() - self._looked < LOOK_SECONDS:
            return False
        self._looked = time.monotonic()
        there = self._is_there()
        if there and self.stream is None:
            self.stream = rr.RecordingStream(APPLICATION)
            self.stream.set_log_time_enabled(False)
            self.stream.connect_grpc(self._url)
            return True
        if not there and self.stream is not None:
            self._leave()
        return False

    def close(self) -> None:
        """Wait a little until the viewer has everything."""
        if self.stream is not None:
            self.stream.flush(timeout_sec=FLUSH_SECONDS)
            self._leave().join(FLUSH_SECONDS)  # a viewer shows an error when its caller dies without a word

    def _leave(self) -> threading.Thread:
        """Disconnect in a thread of its own, which may wait for the viewer for ever."""
        assert self.stream is not None
        gone, self.stream = self.stream, None
        thread = threading.Thread(target=gone.disconnect, daemon=True)
        thread.start()
        return thread

    def _is_there(self) -> bool:
        try:
            socket.create_connection(self._place, timeout=0.5).close()
        except OSError:
            return False
        return True
