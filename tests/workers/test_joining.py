"""Clusters that cannot be joined: one line each, which says what to do, and soon."""

import socket
import subprocess
from types import SimpleNamespace

import pytest

from cutgrammar.errors import InputError
from cutgrammar_workers import joining
from cutgrammar_workers.joining import check_address
from ray_head import ray_head

TOKEN = "0123456789abcdef" * 2


@pytest.mark.parametrize(
    "address",
    ["", "foo", "foo:bar", ":6379", "10.0.0.1", "http://10.0.0.1:6379", "10.0.0.1:99999", "local", "a b:1", "[zz]:1"],
)
def test_a_malformed_address_is_refused_with_the_right_form(address):
    with pytest.raises(InputError, match=r"no address of a Ray cluster; give HEAD:PORT, such as 10\.0\.0\.5:6379"):
        check_address(address)


def test_ray_client_is_refused_with_what_to_use_instead():
    with pytest.raises(InputError, match="is of Ray Client.*ray job submit"):
        check_address("ray://10.0.0.1:10001")


def test_a_malformed_address_in_the_environment_is_refused(monkeypatch):
    monkeypatch.setenv("RAY_ADDRESS", "foo")
    with pytest.raises(InputError, match="'foo' is no address"):
        check_address("auto")


@pytest.mark.parametrize(
    ("printed", "message"),
    [
        ("no-node", "is no node of the Ray cluster at 127.*ray start --address=127.*ray job submit"),
        ("no-cluster it sleeps", r"answers at '127.*' \(it sleeps\); start one"),
    ],
)
def test_every_finding_is_one_line_that_says_what_to_do(printed, message, monkeypatch):
    def run(*_, **__):
        return SimpleNamespace(stdout=f"{printed}\n", returncode=0)

    with socket.create_server(("127.0.0.1", 0)) as server:
        monkeypatch.setattr(subprocess, "run", run)
        with pytest.raises(InputError, match=message) as caught:
            check_address(f"127.0.0.1:{server.getsockname()[1]}")
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_port_that_is_silent_is_given_up(monkeypatch):
    monkeypatch.setattr(joining, "ANSWER_SECONDS", 4.0)
    with socket.create_server(("127.0.0.1", 0)) as server, pytest.raises(InputError, match="has not answered for 4 s"):
        check_address(f"127.0.0.1:{server.getsockname()[1]}")


@pytest.fixture(scope="module")
def guarded():
    """A cluster that wants a token; yields its address."""
    with ray_head(RAY_AUTH_MODE="token", RAY_AUTH_TOKEN=TOKEN) as address:
        yield address


@pytest.mark.slow
@pytest.mark.parametrize(
    ("environment", "message"),
    [
        ({"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": "f" * 32}, "refuses to talk without its token: give it in"),
        ({"RAY_AUTH_MODE": "token"}, "RAY_AUTH_MODE is token, but there is none"),
        ({"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN_PATH": "/none"}, "RAY_AUTH_MODE is token, but there is none"),
        ({"RAY_AUTH_MODE": "disabled"}, "refuses to talk without a token: set RAY_AUTH_MODE=token and give it in"),
        ({}, "refuses to talk without a token: set RAY_AUTH_MODE=token and give it in"),
    ],
)
def test_a_wrong_missing_or_disabled_token_is_one_line(environment, message, guarded, monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("RAY_AUTH_MODE", raising=False)  # Ray sets it in a process that has found a token
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(InputError, match=message) as caught:
        check_address(guarded)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_the_right_token_is_accepted_and_a_foreign_machine_is_told_apart(guarded, monkeypatch):
    monkeypatch.setenv("RAY_AUTH_MODE", "token")
    monkeypatch.setenv("RAY_AUTH_TOKEN", TOKEN)
    check_address(guarded)
    code = "import sys; from ray._private import services; services.find_node_ids = set; "
    code += "from cutgrammar_workers.joining import ask; print(ask(sys.argv[1]))"
    done = subprocess.run([joining.sys.executable, "-c", code, guarded], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "no-node"
