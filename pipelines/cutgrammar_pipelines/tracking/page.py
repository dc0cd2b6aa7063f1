"""MLflow's server without its assistant: the application that `cutgrammar mlflow` starts.

MLflow finds it by the entry point "cutgrammar" of the group `mlflow.app`. On this machine MLflow's pages open an
assistant that asks for a language model's key, and no setting turns it off; here its requests are refused and its
parts hidden. The page that compares runs begins with the settings that differ, where MLflow shows all below a chart.
"""

from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

Message = MutableMapping[str, Any]
Send = Callable[[Message], Awaitable[None]]
Application = Callable[[Message, Callable[[], Awaitable[Message]], Send], Awaitable[None]]

ASSISTANT = "/mlflow/assistant"
"""Part of the path of every request to the assistant."""
HEAD = b"""<style>[data-assistant-ui]{display:none !important}</style>
<script>
localStorage.setItem("mlflow.assistant.fab.autoOpenedOnFirstLoad_v1", "true");
localStorage.setItem("mlflow.assistant.panelOpen_v1", "false");
localStorage.setItem("mlflow.workflowType_v1", JSON.stringify("machine_learning"));
let switched = "";
new MutationObserver(() => {
  const toggle = document.querySelector('[aria-label="Parameters - Show diff only"]');
  if (location.hash.startsWith("#/compare-runs") && toggle && switched !== location.hash) {
    switched = location.hash;
    toggle.click();
    document.querySelector('.CompareRunView [class*="collapse-header"]')?.click();
  }
}).observe(document, {childList: true, subtree: true});
</script>"""
"""What is added to the head of MLflow's one page. The observer lets the compare page show only settings that differ,
and folds the chart above them, which has no scores until some are chosen."""


def make_application() -> Application:
    """MLflow's application, wrapped."""
    from mlflow.server.fastapi_app import app

    return without_assistant(app)


def without_assistant(app: Application) -> Application:
    """An ASGI application that answers as `app` does, but for the assistant."""

    async def answer(scope: Message, receive: Callable[[], Awaitable[Message]], send: Send) -> None:
        if scope["type"] != "http":
            await app(scope, receive, send)
        elif ASSISTANT in scope["path"]:
            await send({"type": "http.response.start", "status": 404, "headers": [(b"content-length", b"0")]})
            await send({"type": "http.response.body", "body": b""})
        elif scope["path"] == "/":
            await app(_uncached(scope), receive, _Page(send).send)
        else:
            await app(scope, receive, send)

    return answer


def _uncached(scope: Message) -> Message:
    """The request without conditions, so that the page is sent in full."""
    conditions = (b"if-none-match", b"if-modified-since", b"range", b"accept-encoding")
    return {**scope, "headers": [(name, value) for name, value in scope["headers"] if name not in conditions]}


class _Page:
    """Sends one HTML page with `HEAD` in its head."""

    def __init__(self, send: Send) -> None:
        self._send = send
        self._start: Message = {}
        self._body = b""

    async def send(self, message: Message) -> None:
        """Keep what comes, until it is complete."""
        if message["type"] == "http.response.start":
            self._start = message
            return
        self._body += message.get("body", b"")
        if message.get("more_body"):
            return
        body = self._body.replace(b"<head>", b"<head>" + HEAD, 1)
        changed = (b"content-length", b"etag", b"last-modified")
        headers = [(name, value) for name, value in self._start["headers"] if name.lower() not in changed]
        headers.append((b"content-length", str(len(body)).encode()))
        await self._send({**self._start, "headers": headers})
        await self._send({"type": "http.response.body", "body": body})
