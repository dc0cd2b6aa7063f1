"""What relays run in their process, in tests."""

import time
from pathlib import Path


class Collector:
    """Writes down the titles of news."""

    def __init__(self, file):
        self._file = Path(file)

    def __call__(self, news):
        with self._file.open("a") as out:
            out.write(f"{news.title}\n")

    def close(self):
        with self._file.open("a") as out:
            out.write("closed\n")


class Stuck:
    """Never returns, as a viewer that hangs does not let a program return."""

    def __call__(self, news):
        time.sleep(600.0)

    def close(self):
        time.sleep(600.0)


class Broken:
    """Raises at every call."""

    def __call__(self, news):
        raise ZeroDivisionError(news.title)

    def close(self):
        raise ZeroDivisionError("close")
