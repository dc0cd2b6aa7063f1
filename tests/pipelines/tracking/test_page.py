import asyncio

from cutgrammar_pipelines.tracking.page import HEAD, without_assistant


def answer(path, headers=()):
    """What the wrapped application answers to one request: status, headers, body, and the requests that reached it."""
    reached, sent = [], []

    async def app(scope, receive, send):
        reached.append(scope)
        await send(
            {"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"34"), (b"etag", b"x")]}
        )
        await send({"type": "http.response.body", "body": b"<html><head>", "more_body": True})
        await send({"type": "http.response.body", "body": b"</head>page</html>"})

    async def receive():
        return {"type": "http.request", "body": b""}

    async def send(message):
        sent.append(message)

    scope = {"type": "http", "path": path, "headers": list(headers)}
    asyncio.run(without_assistant(app)(scope, receive, send))
    body = b"".join(message.get("body", b"") for message in sent)
    return sent[0]["status"], dict(sent[0]["headers"]), body, reached


def test_requests_to_the_assistant_are_refused_and_do_not_reach_mlflow():
    for path in ("/ajax-api/3.0/mlflow/assistant/config", "/prefix/ajax-api/3.0/mlflow/assistant/message"):
        status, _, body, reached = answer(path)
        assert (status, body, reached) == (404, b"", [])


def test_the_page_is_sent_in_full_and_hides_the_assistant():
    status, headers, body, reached = answer("/", [(b"if-none-match", b"x"), (b"host", b"127.0.0.1")])
    assert status == 200
    assert body == b"<html><head>" + HEAD + b"</head>page</html>"
    assert headers == {b"content-length": str(len(body)).encode()}
    assert reached[0]["headers"] == [(b"host", b"127.0.0.1")], "a cached copy would lack what is added"


def test_everything_else_passes_unchanged():
    _, headers, body, _ = answer("/static-files/main.js")
    assert body == b"<html><head></head>page</html>"
    assert headers[b"etag"] == b"x"
