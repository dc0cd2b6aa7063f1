"""What a page answers when it refuses an action, or cannot write what it should keep."""

import errno

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse

from cutgrammar.untrusted import printable


class RefusedError(Exception):
    """An action that is not carried out; nothing has changed.

    Attributes:
        status: of the HTTP answer.
    """

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status = status


def explain_refusals(app: FastAPI) -> None:
    """Let an application answer a `RefusedError`, malformed request or full disk with a `problem` that a page shows.

    The answer to a malformed request does not repeat what was sent.
    """

    @app.exception_handler(RefusedError)
    def refused(_: Request, error: RefusedError) -> JSONResponse:
        return JSONResponse({"problem": str(error)}, error.status)

    @app.exception_handler(RequestValidationError)
    def malformed(_: Request, error: RequestValidationError) -> JSONResponse:
        first = error.errors()[0]
        name = printable(".".join(str(part) for part in first["loc"] if part != "body")[:100])
        return JSONResponse({"problem": f"the request cannot be used: {name}: {first['msg']}"}, 422)

    @app.exception_handler(OSError)
    def not_written(_: Request, error: OSError) -> JSONResponse:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG) or "is full" in str(error)
        reason = "the disk of the server is full" if full else f"the server cannot write ({error.strerror or error})"
        text = f"Not saved: {reason}. What you did before is kept; please tell who invited you, then try again."
        return JSONResponse({"problem": text}, 507)
