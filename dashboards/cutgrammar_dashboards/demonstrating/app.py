"""The demonstration page as a web application.

Answers are finished `JSONResponse`s: meshes are long lists, and FastAPI would look through them number by number.
"""

from collections.abc import Mapping
from typing import Any

from fastapi import FastAPI, HTTPException, Response
from fastapi.responses import HTMLResponse, JSONResponse

from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.slicing import Missed
from cutgrammar_dashboards.demonstrating.collection import Collection
from cutgrammar_dashboards.demonstrating.cutting_state import CuttingState, shifts_apart
from cutgrammar_dashboards.demonstrating.requests import Action, Stroke
from cutgrammar_dashboards.demonstrating.session import Session
from cutgrammar_dashboards.demonstrating.strokes import target_of
from cutgrammar_dashboards.demonstrating.task import Task
from cutgrammar_dashboards.pages.browser_meshes import browser_mesh
from cutgrammar_dashboards.pages.messages import Join, Key
from cutgrammar_dashboards.pages.refusal import RefusedError, explain_refusals
from cutgrammar_dashboards.pages.serving import new_page, render


def demonstration_page(collection: Collection, examples: Mapping[str, bytes]) -> FastAPI:
    """The application.

    Args:
        collection: hands out tasks and keeps the work.
        examples: category -> PNG picture of an object cut into it.
    """
    app = new_page(("demonstrating",))
    explain_refusals(app)

    @app.get("/")
    def page() -> HTMLResponse:
        return render("demonstrating", "record.html")

    @app.get("/examples/{category}.png")
    def example(category: str) -> Response:
        if category not in examples:
            raise HTTPException(404, "no such example")
        return Response(examples[category], media_type="image/png")

    @app.post("/api/join")
    def join(message: Join) -> JSONResponse:
        key, session = collection.join(message.code, message.robot)
        if session is None:
            return JSONResponse({"key": key, "task": None, "progress": collection.progress})
        with session.lock:
            return JSONResponse({"key": key, **_everything(session), "progress": collection.progress})

    @app.get("/api/state")
    def state(key: Key) -> JSONResponse:
        session = collection.session(key)
        with session.lock:
            return JSONResponse({**_everything(session), "progress": collection.progress})

    @app.post("/api/preview")
    def preview(message: Stroke, key: Key) -> JSONResponse:
        session = collection.session(key)
        with session.lock:
            now = session.state
        target = target_of(now, message.stroke())
        if isinstance(target, Missed):
            raise RefusedError(422, target.reason)
        fragment, plane_W = target
        if isinstance(sliced := now.divided(fragment, plane_W), Missed):
            raise RefusedError(422, sliced.reason)
        X_WF, food, skin = now.fragment(fragment).X_WF, *_looks(now, fragment)
        above, below = (
            [browser_mesh(Fragment(mesh, X_WF), food, skin) for mesh in side] for side in (sliced.above, sliced.below)
        )
        facts = {"fragment": fragment, "normal": plane_W.normal.tolist(), "offset": float(plane_W.offset)}
        return JSONResponse({**facts, "above": above, "below": below})

    @app.post("/api/cut")
    def cut(message: Stroke, key: Key) -> JSONResponse:
        session = collection.session(key)
        with session.lock:
            before = session.state.alive
            session.cut(message.after, message.stroke(), message.robot)
            return JSONResponse(_change(session, before))

    @app.post("/api/undo")
    def undo(message: Action, key: Key) -> JSONResponse:
        session = collection.session(key)
        with session.lock:
            before = session.state.alive
            session.undo(message.after, message.seconds, message.robot)
            return JSONResponse(_change(session, before))

    @app.post("/api/save")
    def save(message: Action, key: Key) -> JSONResponse:
        session = collection.session(key)
        with session.lock:
            collection.save(session, message.after, message.seconds, message.robot)
        return JSONResponse({"saved": session.state.task.trial, "progress": collection.progress})

    return app


def _everything(session: Session) -> dict[str, Any]:
    """All that the page shows of a session."""
    task = session.state.task
    return {
        "task": {
            "trial": task.trial,
            "setup": task.setup,
            "instructions": task.instructions,
            "categories": task.categories if task.goal is None else (),
        },
        "goal": _goal(task),
        "names": task.names,
        "seconds": session.seconds,
        **_change(session, ()),
    }


def _change(session: Session, before: tuple[int, ...]) -> dict[str, Any]:
    """What is new since the fragments `before` existed."""
    state = session.state
    return {
        "after": session.actions,
        "cuts": len(state.made),
        "whole": state.unfinished(),
        "alive": state.alive,
        "objects": [state.object_of(i) for i in state.alive],
        "new": {i: browser_mesh(state.fragment(i), *_looks(state, i)) for i in state.alive if i not in before},
        "shifts": {i: shift.tolist() for i, shift in state.shifts().items()},
    }


def _goal(task: Task) -> dict[str, Any] | None:
    """The goal that is shown beside the board, if there is one."""
    if task.goal is None:
        return None
    objects, fragments = [number for number, _ in task.goal], [fragment for _, fragment in task.goal]
    return {
        "new": {
            i: browser_mesh(fragment, task.foods[number], task.flat[number])
            for i, (number, fragment) in enumerate(task.goal)
        },
        "shifts": {i: shift.tolist() for i, shift in enumerate(shifts_apart(fragments, objects))},
    }


def _looks(state: CuttingState, fragment: int) -> tuple[str, float]:
    """The food of a fragment, and the largest flat part of its skin [m2]."""
    number = state.object_of(fragment)
    return state.task.foods[number], state.task.flat[number]
