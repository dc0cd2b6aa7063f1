"""The guard in front of every page: it refuses requests before the page's own code sees them.

- The Host header must be a known one, which defeats DNS rebinding.
- A request that changes something must come from a page of this server (Origin, and Sec-Fetch-Site if sent).
- A server that others can reach wants its token, once in the address, then in a cookie that scripts cannot read.
- Bodies have a maximum size, whatever Content-Length says.

All answers forbid the browser to load, embed or send anything elsewhere (content security policy).
"""

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

from cutgrammar_dashboards.pages.access import Access

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]

MAX_BODY = 65_536
"""Maximum size of a request's body [bytes]."""
COOKIE = "cutgrammar_token"
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
)


class Guard:
    """An ASGI application in front of another."""

    def __init__(self, app: Application, access: Access, max_body: int = MAX_BODY) -> None:
        self._app = app
        self._access = access
        self._max_body = max_body

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":  # no page uses web sockets
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        refused = self._refusal(scope, headers)
        if refused is not None:
            await _answer(send, *refused)
            return
        body = await _body(receive, self._max_body)
        if body is None:
            await _answer(send, 413, f"the request is larger than {self._max_body} bytes")
            return
        cookie = self._new_cookie(scope)

        async def replay() -> MutableMapping[str, Any]:
            nonlocal body
            if body is None:
                return await receive()
            content, body = body, None
            return {"type": "http.request", "body": content, "more_body": False}

        async def with_headers(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *HEADERS, *cookie]
            await send(message)

        await self._app(scope, replay, with_headers)

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        """Status and reason why a request is refused, or None."""
        if headers.get("host", "").lower() not in self._access.hosts:
            return 403, "this server does not answer under that host name; start it with --allowed-hosts NAME"
        if scope["method"] not in ("GET", "HEAD", "POST"):
            return 405, "only GET and POST are known"
        if scope["method"] == "POST":
            origin = headers.get("origin", "")
            if origin.partition("://")[2].lower() not in self._access.hosts or not origin.startswith(
                ("http://", "https://")
            ):
                return 403, "the request does not come from a page of this server"
            if headers.get("sec-fetch-site", "same-origin") != "same-origin":
                return 403, "the request does not come from a page of this server"
        if not self._knows_token(scope, headers):
            return 401, "open the address that the server printed, with its token"
        length = headers.get("content-length", "0")
        if not length.isdigit() or int(length) > self._max_body:
            return 413, f"the request is larger than {self._max_body} bytes"
        return None

    def _knows_token(self, scope: Scope, headers: dict[str, str]) -> bool:
        token = self._access.token
        if token is None:
            return True
        try:
            morsel = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        except CookieError:
            morsel = None
        shown = [morsel.value if morsel else "", _token_in_address(scope)]
        return any(secrets.compare_digest(token.encode(), other.encode()) for other in shown)

    def _new_cookie(self, scope: Scope) -> list[tuple[bytes, bytes]]:
        """The cookie with the token, for a browser that showed it in the address."""
        if self._access.token is None or not _token_in_address(scope):
            return []
        return [(b"set-cookie", f"{COOKIE}={self._access.token}; HttpOnly; SameSite=Strict; Path=/".encode())]


def _token_in_address(scope: Scope) -> str:
    query: bytes = scope["query_string"]
    return parse_qs(query.decode("latin-1")).get("token", [""])[0]


async def _body(receive: Receive, limit: int) -> bytes | None:
    """The body of a request; None if it is larger than `limit`."""
    parts, size = [], 0
    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            return b""
        parts.append(message.get("body", b""))
        size += len(parts[-1])
        if size > limit:
            return None
        if not message.get("more_body", False):
            return b"".join(parts)


async def _answer(send: Send, status: int, reason: str) -> None:
    headers = [(b"content-type", b"text/plain; charset=utf-8"), *HEADERS]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": f"{reason}\n".encode()})
