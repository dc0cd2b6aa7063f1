"""The connections of a page's server: when there are too many, those that wait for longest are closed.

So clients that say nothing, send half a request or read no answer never keep a person out, nor use up the files that
the process may open, which the work of people needs, too.
"""

import asyncio
import resource
from functools import cache

from uvicorn.protocols.http.h11_impl import H11Protocol

MOST = 500
"""Maximum number of connections; a browser opens up to six."""
MAX_BACKLOG = 16
"""Maximum number of connections that are accepted at once, before any of them can be closed again."""
RESERVED = 100
"""Files that are left for the work, and for connections that are accepted before others are closed."""


@cache
def max_connections() -> int:
    """How many connections this process can hold, after its limit of open files was raised where that is too low."""
    files, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MOST + RESERVED
    if files != resource.RLIM_INFINITY and files < wanted:
        files = wanted if most == resource.RLIM_INFINITY else min(wanted, most)
        resource.setrlimit(resource.RLIMIT_NOFILE, (files, most))
    return MOST if files == resource.RLIM_INFINITY else max(8, min(MOST, files - RESERVED))


def backlog() -> int:
    """How many connections are accepted at once, and how many the system keeps for that; others have to try again.

    They are few beside `max_connections`, so that a person's request is read before that connection is the oldest.
    """
    return max(1, min(MAX_BACKLOG, max_connections() // 8))


class Connection(H11Protocol):
    """A connection that knows since when it waits for its client."""

    _since = 0.0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take up a connection, and close the one that waits for longest if there are too many."""
        super().connection_made(transport)
        self._since = self.loop.time()
        while len(self.connections) > max_connections() and (waiting := self._waiting()):
            oldest = min(waiting, key=lambda one: one._since)
            self.connections.discard(oldest)
            oldest.transport.abort()

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        self._since = self.loop.time()
        super().on_response_complete()

    def _waiting(self) -> "list[Connection]":
        """The other connections, but those whose request is being carried out."""
        return [
            one
            for one in self.connections
            if isinstance(one, Connection)
            and one is not self
            and (one.cycle is None or one.cycle.more_body or one.cycle.response_started)
        ]
