"""The rating page as a web application."""

import json

from fastapi import FastAPI, Response
from fastapi.responses import HTMLResponse

from cutgrammar_dashboards.pages.messages import Join, Key
from cutgrammar_dashboards.pages.refusal import RefusedError, explain_refusals
from cutgrammar_dashboards.pages.serving import new_page, render
from cutgrammar_dashboards.rating.messages import Answer
from cutgrammar_dashboards.rating.panel import Panel, Rater
from cutgrammar_dashboards.rating.shown_pair import ShownPairs


def rating_page(panel: Panel, shown: ShownPairs) -> FastAPI:
    """The application.

    Args:
        panel: the raters and what is kept of their answers.
        shown: makes what the browser shows.
    """
    app = new_page(("rating",))
    explain_refusals(app)

    @app.get("/")
    def page() -> HTMLResponse:
        return render("rating", "rate.html")

    @app.post("/api/join")
    def join(message: Join) -> Response:
        key, rater = panel.join(message.code)
        with rater.lock:
            return _state(panel, shown, rater, rater.answered, key)

    @app.get("/api/pair/{place}")
    def pair(place: int, key: Key) -> Response:
        rater = panel.rater(key)
        with rater.lock:
            if not 0 <= place <= rater.answered:
                raise RefusedError(422, "this pair has not been shown to you")
            return _state(panel, shown, rater, place)

    @app.post("/api/rate")
    def rate(message: Answer, key: Key) -> Response:
        rater = panel.rater(key)
        with rater.lock:
            place = panel.answer(rater, message.pair, message.after, message.rating, message.seconds, message.robot)
            return _state(panel, shown, rater, place + 1)

    return app


def _state(panel: Panel, shown: ShownPairs, rater: Rater, place: int, key: str | None = None) -> Response:
    """All that the page shows at a place of the rater's order; behind the last pair, only how many there are."""
    state: dict[str, object] = {"place": place, "pairs": len(rater.pairs), "after": rater.answers}
    state |= {"answered": rater.answered} | ({"key": key} if key else {})
    sides = b""
    if place < len(rater.pairs):
        pair = rater.pairs[place]
        given = rater.rating(pair)
        state |= {"pair": panel.name(rater, pair), "rating": given.rating if given else None}
        sides = b',"goal":%b,"result":%b' % shown.sides(pair)
    content = json.dumps(state).encode()[:-1] + sides + b"}"
    return Response(content, media_type="application/json", headers={"Cache-Control": "no-store"})
