"""What pages refuse before their own code sees it."""

import pytest
from fastapi import FastAPI, Request
from fastapi.testclient import TestClient

from cutgrammar.errors import InputError
from cutgrammar_dashboards.pages.access import access_to
from cutgrammar_dashboards.pages.guard import MAX_BODY, Guard
from cutgrammar_dashboards.pages.serving import new_page

HOME = "http://127.0.0.1:8765"


def client_of(access):
    app = new_page(())

    @app.post("/size")
    async def size(request: Request):
        return len(await request.body())

    @app.get("/")
    def home():
        return "home"

    return TestClient(Guard(app, access), base_url=HOME)


@pytest.fixture
def local():
    return client_of(access_to("127.0.0.1", 8765))


@pytest.fixture
def shared():
    return client_of(access_to("0.0.0.0", 8765, ["lab-pc.local", "127.0.0.1"], token="s3cret"))


def test_a_page_answers_this_machine(local):
    assert local.get("/").status_code == 200
    assert local.post("/size", content=b"abc", headers={"Origin": HOME}).json() == 3


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8765", "127.0.0.1:9999", "127.0.0.1.evil.example:8765", ""]
)
def test_a_foreign_host_is_refused(local, host):
    assert local.get("/", headers={"Host": host}).status_code == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "", "http://127.0.0.1:9999", "ftp://127.0.0.1:8765"])
def test_a_change_from_a_foreign_origin_is_refused(local, origin):
    assert local.post("/size", content=b"x", headers={"Origin": origin}).status_code == 403


def test_a_change_without_origin_or_from_another_site_is_refused(local):
    assert local.post("/size", content=b"x").status_code == 403
    headers = {"Origin": HOME, "Sec-Fetch-Site": "cross-site"}
    assert local.post("/size", content=b"x", headers=headers).status_code == 403


def test_an_oversized_body_is_refused_with_and_without_a_length(local):
    large = b"x" * (MAX_BODY + 1)
    assert local.post("/size", content=large, headers={"Origin": HOME}).status_code == 413
    chunks = (large[i : i + 1000] for i in range(0, len(large), 1000))
    assert local.post("/size", content=chunks, headers={"Origin": HOME}).status_code == 413
    assert local.post("/size", content=large[1:], headers={"Origin": HOME}).json() == MAX_BODY


def test_other_methods_are_refused(local):
    assert local.request("DELETE", "/", headers={"Origin": HOME}).status_code == 405


def test_a_shared_page_wants_its_token_once(shared):
    assert shared.get("/").status_code == 401
    assert shared.get("/?token=guess").status_code == 401
    first = shared.get("/?token=s3cret")
    assert first.status_code == 200
    assert "HttpOnly" in first.headers["set-cookie"]
    assert "SameSite=Strict" in first.headers["set-cookie"]
    assert shared.get("/").status_code == 200
    shared.cookies.clear()
    assert shared.get("/", headers={"Cookie": "cutgrammar_token=guess"}).status_code == 401


def test_a_shared_page_answers_to_its_names_only(shared):
    headers = {"Host": "lab-pc.local:8765"}
    assert shared.get("/?token=s3cret", headers=headers).status_code == 200
    assert shared.get("/?token=s3cret", headers={"Host": "other.local:8765"}).status_code == 403


def test_loopback_needs_no_token_and_all_else_gets_one():
    assert access_to("127.0.0.1", 1).token is None
    assert access_to("localhost", 1).token is None
    token = access_to("192.168.1.5", 1).token
    assert token is not None
    assert len(token) >= 32
    with pytest.raises(InputError, match="--allowed-hosts"):
        access_to("0.0.0.0", 1)
    with pytest.raises(InputError, match="not an IP address"):
        access_to("lab-pc", 1)


@pytest.mark.parametrize(
    "path",
    [
        "/static/../app.py",
        "/static/..%2f..%2fserving.py",
        "/static/%2e%2e/guard.py",
        "/static//etc/passwd",
        "/static/x.js",
    ],
)
def test_no_address_reaches_another_file(local, path):
    assert local.get(path).status_code == 404


def test_every_answer_forbids_to_load_anything_from_elsewhere(local):
    for answer in (local.get("/"), local.get("/nothing"), local.get("/", headers={"Host": "evil.example"})):
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "script-src 'self';" in policy
        assert "frame-ancestors 'none'" in policy
        assert answer.headers["x-content-type-options"] == "nosniff"


def test_three_js_comes_from_an_installed_package(local):
    answer = local.get("/static/three.js")
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/javascript")
    assert "OrbitControls" in answer.text


def test_the_application_without_a_guard_has_no_documentation_pages():
    assert isinstance(new_page(()), FastAPI)
    client = TestClient(new_page(()))
    assert client.get("/docs").status_code == client.get("/openapi.json").status_code == 404
