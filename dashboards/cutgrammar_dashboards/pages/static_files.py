"""The files that a page loads: our own, and three.js from the installed package NiceGUI, which bundles it as a module.

A file is served under a name from a fixed list, so no address can reach another file.
"""

import importlib.util
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path

from fastapi import APIRouter, HTTPException, Response

from cutgrammar.errors import InputError

THREE = Path("elements", "scene", "dist", "index.js")
"""The bundle of three.js in the package `nicegui`: an ES module that exports THREE and OrbitControls."""
KINDS = {".js": "text/javascript; charset=utf-8", ".css": "text/css; charset=utf-8"}


@cache
def three_js() -> Path:
    """The file with three.js; NiceGUI itself is not imported.

    Raises:
        InputError: NiceGUI is not installed, or does not bundle three.js where it did.
    """
    found = importlib.util.find_spec("nicegui")
    place = Path(found.origin).parent / THREE if found is not None and found.origin else None
    if place is None or not place.is_file():
        raise InputError("three.js is missing: the pages take it from NiceGUI; try pip install 'nicegui>=3.18,<4'")
    return place


def static_files(rooms: Iterable[str]) -> Mapping[str, bytes]:
    """Name -> content of the folder `static` of these rooms of the dashboards, and three.js."""
    found = {"three.js": three_js().read_bytes()}
    for room in rooms:
        folder = files(f"cutgrammar_dashboards.{room}") / "static"
        found |= {file.name: file.read_bytes() for file in folder.iterdir() if Path(file.name).suffix in KINDS}
    return found


def static_routes(rooms: Iterable[str]) -> APIRouter:
    """Routes that serve the `static_files` of these rooms under /static/."""
    contents = static_files(rooms)
    routes = APIRouter()

    @routes.get("/static/{name}")
    def static(name: str) -> Response:
        if name not in contents:
            raise HTTPException(404, "no such file")
        caching = "max-age=3600" if name == "three.js" else "no-cache"
        return Response(contents[name], media_type=KINDS[Path(name).suffix], headers={"Cache-Control": caching})

    return routes
