"""Hostile clients of a page that a running command serves: what they send, by plain sockets."""

import contextlib
import json
import socket
import struct
import time
from collections.abc import Callable, Iterator, Sequence
from random import Random

from hostile.mutations import changed_message
from hostile.random_values import change_bytes

PATHS = (
    "/static/../../../../../../etc/passwd",
    "/static/..%2f..%2f..%2f..%2f..%2fetc%2fpasswd",
    "/static/%2e%2e/%2e%2e/%2e%2e/etc/passwd",
    "/static//etc/passwd",
    "/static/....//....//etc/passwd",
    "/static/..\\..\\etc\\passwd",
    "/static/three.js%00.css",
    "/static/%ff%fe",
    "/examples/../../etc/passwd",
    "/examples/..%2f..%2f..%2fetc%2fpasswd.png",
    "//etc/passwd",
    "/../../etc/passwd",
    "/%2e%2e/etc/passwd",
    "/data/manifest.json",
    "/sessions/trial-00000.jsonl",
    "/ratings.sqlite",
    "file:///etc/passwd",
    "http://127.0.0.1/etc/passwd",
    "*",
    "/api/pair/..%2f..%2fx",
    "/?" + "a" * 60_000,
)
"""Addresses that no page has."""
HANDSHAKE = (
    "GET {path} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
)
MESSAGES = (
    ("/api/join", {"code": "stranger", "robot": True}),
    ("/api/undo", {"after": 0, "seconds": 1.0, "robot": True}),
    ("/api/save", {"after": 0, "seconds": 1.0, "robot": True}),
    ("/api/rate", {"after": 0, "pair": "0" * 24, "rating": 3, "seconds": 1.0, "robot": True}),
    (
        "/api/cut",
        {
            "after": 0,
            "eye": [0.0, -1.0, 0.5],
            "first": [0.0, 1.05, -0.4],
            "second": [0.0, 0.9, -0.5],
            "explode": 0.0,
            "first_seconds": 1.0,
            "second_seconds": 2.0,
            "seconds": 3.0,
            "robot": True,
        },
    ),
)
"""Messages that a page of ours sends, before they are changed."""
Attack = Callable[[int, Random], None]


def request(port: int, path: str, message: object = None, method: str = "", **headers: str) -> bytes:
    """A request as a page of the server at `port` would send it, but for these headers."""
    body = b"" if message is None else message if isinstance(message, bytes) else json.dumps(message).encode()
    own = {
        "Host": f"127.0.0.1:{port}",
        "Origin": f"http://127.0.0.1:{port}",
        "Content-Type": "application/json",
        "X-Session": "x",
        "Connection": "close",
        "Content-Length": str(len(body)),
    } | {name.replace("_", "-"): value for name, value in headers.items()}
    lines = [f"{method or ('GET' if message is None else 'POST')} {path} HTTP/1.1"]
    lines += [f"{name}: {value}" for name, value in own.items()]
    return "\r\n".join([*lines, "", ""]).encode("latin-1", "replace") + body


@contextlib.contextmanager
def connection(port: int, seconds: float = 20.0) -> Iterator[socket.socket]:
    """A connection to the server; what a server that closes it early does to us is no fault."""
    with (
        contextlib.suppress(BrokenPipeError, ConnectionError, TimeoutError),
        socket.create_connection(("127.0.0.1", port), timeout=seconds) as connected,
    ):
        yield connected


def answer_to(port: int, content: bytes, seconds: float = 3.0, *, ends: bool = False) -> bytes:
    """What the server answers to these bytes until it closes the connection, or says nothing for some seconds.

    With `ends` our side is closed after them, which the server need not answer.
    """
    answer = b""
    with connection(port, seconds) as connected:
        with contextlib.suppress(BrokenPipeError, ConnectionError):
            connected.sendall(content)
            if ends:
                connected.shutdown(socket.SHUT_WR)
        while part := connected.recv(1 << 16):
            answer += part
    return answer


def garbage(port: int, rng: Random) -> None:
    """Bytes that are no HTTP, or only begin like it."""
    good = request(port, "/api/join", MESSAGES[0][1])
    for content in (
        rng.randbytes(5000),
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + rng.randbytes(500),
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
        b"\r\n" * 5000,
        b"\x00" * 5000,
        b"GET /\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET / HTTP/1.0\r\n\r\n",
        b"\x1b]0;title\x07\x1b[2J HTTP/1.1\r\n\r\n",
        "GET /é HTTP/1.1\r\n\r\n".encode(),
        *(change_bytes(rng, good) for _ in range(100)),
    ):
        answer_to(port, content, ends=True)


def messages(port: int, rng: Random) -> None:
    """Messages of our pages, changed, with the key of somebody or of nobody."""
    joined = answer_to(port, request(port, *MESSAGES[0]))
    key = json.loads(joined.partition(b"\r\n\r\n")[2] or b"{}").get("key", "x") if b" 200 " in joined[:20] else "x"
    for number in range(150):
        path, message = MESSAGES[rng.randrange(1, len(MESSAGES))] if number else MESSAGES[0]
        body = changed_message(rng, json.loads(json.dumps(message)))
        told = answer_to(port, request(port, path, body, X_Session=rng.choice((key, key, "x" * 5000, "é", ""))))
        if b" 500 " in told[:20]:
            raise AssertionError(f"{path} answers {told[:200]!r} to {body[:300]!r}")


def giants(port: int, _: Random) -> None:
    """Headers, paths, bodies and lengths without measure."""
    host = f"Host: 127.0.0.1:{port}\r\n".encode()
    post = b"POST /api/join HTTP/1.1\r\n" + host + f"Origin: http://127.0.0.1:{port}\r\n".encode()
    chunk = b"10000\r\n" + b"a" * 0x10000 + b"\r\n"
    for content in (
        b"GET /" + b"a" * 5_000_000 + b" HTTP/1.1\r\n" + host + b"\r\n",
        b"GET / HTTP/1.1\r\n" + host + b"X: " + b"a" * 5_000_000 + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + host + b"X: a\r\n" * 200_000 + b"\r\n",
        post + b"Transfer-Encoding: chunked\r\n\r\n" + chunk * 300,
        post + b"Transfer-Encoding: chunked\r\n\r\n" + b"f" * 5000 + b"\r\n",
        post + b"Content-Length: 5000000\r\n\r\n" + b"a" * 5_000_000,
        *(
            post + b"Content-Length: " + length + b"\r\n\r\n" + b"{}"
            for length in (b"9" * 30, b"-1", b"+2", b"2, 3", b"2\r\nContent-Length: 3", b"0x2", "٢".encode())
        ),
        post + b"Content-Length: 2\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\nGET / HTTP/1.1\r\n\r\n",
        post + b"Expect: 100-continue\r\nContent-Length: 60000\r\n\r\n",
    ):
        answer_to(port, content)


def web_sockets(port: int, rng: Random) -> None:
    """Handshakes of web sockets, which no page has, and frames after them."""
    host = f"127.0.0.1:{port}"
    frames = (
        b"",
        b"\x81\xfe\xff\xff" + rng.randbytes(5000),
        b"\x82\xff\x7f\xff\xff\xff\xff\xff\xff\xff" + rng.randbytes(5000),
        b"\x88\x80" + rng.randbytes(4),
        rng.randbytes(100_000),
    )
    for path in ("/", "/api/join", "/ws", "/static/three.js"):
        for frame in frames:
            if b"101 Switching" in answer_to(port, HANDSHAKE.format(path=path, host=host).encode() + frame, 1.0):
                raise AssertionError(f"{path} speaks WebSocket")


def foreign_headers(port: int, rng: Random) -> None:
    """Requests for other hosts, and changes from foreign pages: none is carried out."""
    names = ("evil.example", f"evil.example:{port}", f"127.0.0.1.evil.example:{port}", "127.0.0.1", "", "\x1b[2J", "é")
    for path, message in MESSAGES:
        for name in names:
            for headers in ({"Host": name}, {"Origin": f"http://{name}"}, {"Sec-Fetch-Site": "cross-site"}):
                told = answer_to(port, request(port, path, message, **headers))
                if b" 200 " in told[:20]:
                    raise AssertionError(f"{path} answers to {headers}")
    for method in ("PUT", "DELETE", "OPTIONS", "TRACE", "CONNECT", "PATCH", "get", rng.choice(("A" * 5000, "\x00"))):
        told = answer_to(port, request(port, "/", method=method))
        if b" 200 " in told[:20]:
            raise AssertionError(f"{method[:20]} is answered")


def foreign_paths(port: int, _: Random) -> None:
    """Addresses that lead out of what a page serves."""
    for path in PATHS:
        told = answer_to(port, f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n".encode())
        if b"root:" in told or (b" 200 " in told[:20] and not path.startswith("/?")):
            raise AssertionError(f"{path[:80]} is answered {told[:200]!r}")


def broken_off(port: int, rng: Random) -> None:
    """Connections that are closed or reset within a message, or before its answer."""
    for path, message in MESSAGES * 6:
        content = request(port, path, message)
        with connection(port) as connected:
            if rng.random() < 0.5:
                connected.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            connected.sendall(content[: rng.choice((1, 20, len(content) - 1, len(content)))])
    for _ in range(10):
        with connection(port) as connected:
            connected.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            connected.sendall(request(port, "/static/three.js", Connection="keep-alive") * 20)
            connected.recv(1000)


def deaf(port: int, _: Random) -> None:
    """Clients that ask for much and read nothing."""
    with contextlib.ExitStack() as stack:
        for _ in range(20):
            one = stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=2.0))
            with contextlib.suppress(TimeoutError, ConnectionError):
                one.sendall(request(port, "/static/three.js", Connection="keep-alive") * 200)
        expect_answers(port)


def many(port: int, _: Random, count: int = 200) -> None:
    """Many connections that say nothing, or say half a request, byte by byte; others are answered meanwhile."""
    content = request(port, "/api/join", MESSAGES[0][1])
    with contextlib.ExitStack() as stack:
        slow: list[socket.socket] = []
        for _ in range(count):
            with contextlib.suppress(ConnectionError, TimeoutError):
                slow.append(stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=5.0)))
        for at in range(5):
            for number, one in enumerate(slow):
                with contextlib.suppress(ConnectionError, TimeoutError):
                    one.sendall(content[: len(content) - 20] if at == 0 and number % 3 == 0 else content[at : at + 1])
            expect_answers(port)


def expect_answers(port: int, seconds: float = 30.0) -> None:
    """Check that the server answers a person's browser.

    Raises:
        AssertionError: it does not.
    """
    until = time.monotonic() + seconds
    told = b""
    while time.monotonic() < until:
        with contextlib.suppress(ConnectionError, TimeoutError):
            told = answer_to(port, request(port, "/"))
        if told.startswith(b"HTTP/1.1 200"):
            return
        time.sleep(0.2)
    raise AssertionError(f"the server does not answer: {told[:200]!r}")


ATTACKS: Sequence[Attack] = (
    garbage,
    messages,
    giants,
    web_sockets,
    foreign_headers,
    foreign_paths,
    broken_off,
    deaf,
    many,
)
