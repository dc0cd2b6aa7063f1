"""Whether a Ray cluster can be joined, found out within seconds; Ray itself tries for a minute and then says little.

As a program, this module asks one cluster and prints what it found. It is run in a process of its own, because Ray's
client can hang where something else listens, and writes to the terminal.
"""

import ipaddress
import os
import re
import socket
import subprocess
import sys

from cutgrammar.errors import InputError

CONNECT_SECONDS = 5.0
"""Time limit of the first connection [s]."""
ANSWER_SECONDS = 20.0
"""Time limit of the cluster's answers [s]; the first import of Ray takes some of it."""
FORM = "give HEAD:PORT, such as 10.0.0.5:6379, or auto for the Ray of this machine"
SUBMIT = "ray job submit --address http://HEAD:8265 -- cutgrammar ..."


def check_address(address: str) -> None:
    """Raise unless the cluster at `address` lets this process join.

    Raises:
        InputError: the address is malformed, nothing or something else listens there, the token is missing or wrong, or
            this machine is no node of the cluster.
    """
    named = os.environ.get("RAY_ADDRESS", "auto") if address == "auto" else address
    if named != "auto":
        host, port = host_and_port(named)
        try:
            socket.create_connection((host, port), timeout=CONNECT_SECONDS).close()
        except OSError as error:
            raise no_cluster(named, first_line(error)) from error
    command = [sys.executable, "-m", "cutgrammar_workers.joining", named]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=ANSWER_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        raise no_cluster(named, f"it has not answered for {ANSWER_SECONDS:.0f} s") from None
    finding, _, detail = (done.stdout.strip().splitlines() or [""])[-1].partition(" ")
    if done.returncode < 0:
        raise no_cluster(named, f"Ray's client died of signal {-done.returncode}")
    if finding == "no-cluster":
        raise no_cluster(named, detail)
    if finding == "token":
        wanted = "a token: set RAY_AUTH_MODE=token and" if os.environ.get("RAY_AUTH_MODE") != "token" else "its token:"
        raise InputError(
            f"the Ray cluster at {named} refuses to talk without {wanted} give it in ~/.ray/auth_token or "
            "RAY_AUTH_TOKEN (ray get-auth-token shows it on the head)"
        )
    if finding == "no-token":
        raise InputError(
            f"RAY_AUTH_MODE is token, but there is none ({detail}); put the cluster's into ~/.ray/auth_token or "
            "RAY_AUTH_TOKEN (ray get-auth-token shows it on the head)"
        )
    if finding == "no-node":
        raise InputError(
            f"this machine is no node of the Ray cluster at {named}; make it one (ray start --address={named}), or "
            f"let a node run the command: {SUBMIT}"
        )


def host_and_port(address: str) -> tuple[str, int]:
    """The parts of HOST:PORT, or [IPV6]:PORT.

    Raises:
        InputError: the address has another form.
    """
    if address.startswith("ray://"):
        raise InputError(f"--address {address} is of Ray Client, which evaluations cannot use; {FORM}, or use {SUBMIT}")
    found = re.fullmatch(r"(\[[0-9A-Fa-f:.]+\]|[^\s:/\[\]]+):([0-9]{1,5})", address)
    host, port = (found[1].strip("[]"), int(found[2])) if found else ("", 0)
    if ":" in host:
        try:
            ipaddress.IPv6Address(host)
        except ValueError:
            host = ""
    if not host or not 0 < port < 65536:
        raise InputError(f"--address {address!r} is no address of a Ray cluster; {FORM}")
    return host, port


def first_line(error: BaseException) -> str:
    """The first line of an error's message, or its type where it has none."""
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__


def no_cluster(address: str, reason: str) -> InputError:
    """The error that no cluster is at `address`."""
    return InputError(
        f"no Ray cluster answers at {address!r} ({reason}); start one, give its HEAD:PORT, or leave --address out"
    )


def ask(address: str) -> str:
    """One of the findings of `check_address`, and its reason; "joinable" if nothing is wrong, or not known to be."""
    from ray._private import services
    from ray._private.authentication import authentication_token_setup as tokens
    from ray._raylet import GcsClient  # type: ignore[attr-defined]  # compiled
    from ray.exceptions import AuthenticationError, RpcError

    try:
        if address == "auto":
            tokens.maybe_enable_token_auth_if_token_available(warn_if_disabled=False)
        tokens.ensure_token_if_auth_enabled(None, create_token_if_missing=False)  # else the client aborts the process
        client = GcsClient(address=services.canonicalize_bootstrap_address_or_die(address))
        nodes = client.get_all_node_info(timeout=ANSWER_SECONDS / 2)
        return "joinable" if {node.hex() for node in nodes} & set(services.find_node_ids()) else "no-node"
    except AuthenticationError as error:
        return "token" if "InvalidAuthToken" in str(error) else f"no-token {first_line(error).partition('. ')[0]}"
    except (ConnectionError, RpcError) as error:
        return f"no-cluster {first_line(error)}"
    except (AttributeError, TypeError):  # another version of Ray has other names for this: let Ray itself join
        return "joinable"


if __name__ == "__main__":
    print(ask(sys.argv[1]))
