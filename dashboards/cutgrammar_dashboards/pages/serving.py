"""Making and serving a page: a FastAPI application behind the guard, in one process with threads."""

import socket
from collections.abc import Iterable

import jinja2
import uvicorn
from fastapi import FastAPI
from fastapi.responses import HTMLResponse

from cutgrammar.errors import InputError
from cutgrammar_dashboards.pages.access import Access
from cutgrammar_dashboards.pages.connections import Connection, backlog
from cutgrammar_dashboards.pages.guard import Guard
from cutgrammar_dashboards.pages.static_files import static_routes


def new_page(rooms: Iterable[str]) -> FastAPI:
    """An application without routes but those of the static files of `pages` and these rooms."""
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    app.include_router(static_routes(("pages", *rooms)))
    return app


def render(room: str, template: str, **values: object) -> HTMLResponse:
    """A template of the folder `templates` of a room, with all values escaped."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(f"cutgrammar_dashboards.{room}"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return HTMLResponse(environment.get_template(template).render(values), headers={"Cache-Control": "no-store"})


def bound_socket(host: str, port: int) -> socket.socket:
    """A socket that listens at this address; port 0 finds a free one.

    Raises:
        InputError: the address cannot be used.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
        listening.listen(128)  # browsers that come before the application is ready wait
    except OSError as error:
        listening.close()
        raise InputError(f"port {port} of {host} cannot be used ({error.strerror}); choose another --port") from None
    return listening


class _Server(uvicorn.Server):
    """Prints the address of the page once it answers, and Ctrl-C ends it in any case."""

    def __init__(self, config: uvicorn.Config, address: str) -> None:
        super().__init__(config)
        self._address = address

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        print(f"the page is at {self._address}", flush=True)


def serve(app: FastAPI, access: Access, listening: socket.socket) -> None:
    """Serve a page, and print its address, until the process is interrupted."""
    config = uvicorn.Config(
        Guard(app, access),
        log_level="error",  # clients that speak no HTTP are no news
        access_log=False,
        use_colors=False,
        server_header=False,
        ws="none",
        loop="asyncio",
        http=Connection,
        backlog=backlog(),
    )
    _Server(config, access.address).run(sockets=[listening])
