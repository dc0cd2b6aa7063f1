"""Servers at MLflow's place that answer in every way but the right one."""

import contextlib
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


class Sick(BaseHTTPRequestHandler):
    """Answers every request in the way of its class."""

    protocol_version = "HTTP/1.1"

    def do_GET(self):
        self.answer()

    do_POST = do_GET

    def log_message(self, *_):
        pass

    def say(self, status, body=b"{}", **headers):
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)


class Busy(Sick):
    def answer(self):
        self.say(429, Retry_After="3600")


class Dripping(Sick):
    def answer(self):
        self.send_response(200)
        self.send_header("Content-Length", "1000000")
        self.end_headers()
        with contextlib.suppress(OSError):
            for _ in range(600):
                self.wfile.write(b" ")
                time.sleep(0.2)


class Silent(Sick):
    def answer(self):
        time.sleep(120)


class Closed(Sick):
    def answer(self):
        self.say(401, b"who are you?")


class Confused(Sick):
    """Answers with JSON that is none of MLflow's."""

    def answer(self):
        self.say(200, b'{"experiment": [1, {"name": null}], "runs": 7}')


class Talkative(Sick):
    """Repeats the password, in several lines."""

    def answer(self):
        self.say(500, b'{"error_code": "INTERNAL_ERROR", "message": "user:s3cr%3At and s3cr:t\\nare wrong"}')


@contextlib.contextmanager
def serving(kind):
    server = ThreadingHTTPServer(("127.0.0.1", 0), kind)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield server.server_address[1]
    finally:
        server.shutdown()
