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
BACKLOG = 16
"""Connections that are accepted at once, before any of them can be closed again."""
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
