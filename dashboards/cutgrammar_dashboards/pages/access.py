"""Who may open a page: addresses that the server answers to, and the token of a server that others can reach."""

import ipaddress
import secrets
from collections.abc import Sequence
from dataclasses import dataclass

from cutgrammar.errors import InputError


@dataclass(frozen=True)
class Access:
    """Where a page is served and who may open it.

    Attributes:
        host: address that the server binds to.
        port: its port.
        hosts: the values of the Host header that are answered, in lower case.
        token: what a browser has to show; None on the loopback address, which only this machine reaches.
    """

    host: str
    port: int
    hosts: frozenset[str]
    token: str | None

    @property
    def address(self) -> str:
        """The address to open, with the token."""
        name = f"[{self.host}]" if ":" in self.host else self.host
        shown = "localhost" if self.host in ("0.0.0.0", "::") else name
        return f"http://{shown}:{self.port}/" + (f"?token={self.token}" if self.token else "")


def access_to(host: str, port: int, allowed_hosts: Sequence[str] = (), token: str | None = None) -> Access:
    """The access to a page at `host` and `port`.

    Args:
        host: IP address to bind to, or "localhost".
        port: its port.
        allowed_hosts: names, with or without port, under which other machines open the page.
        token: to use instead of a new one, for a server that others can reach.

    Raises:
        InputError: `host` is no IP address, or one that others can reach and nothing says under which name.
    """
    names = {"localhost", "127.0.0.1", "[::1]"}
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host)
    except ValueError:
        raise InputError(
            f"host {host!r} is not an IP address; 127.0.0.1 is this machine, 0.0.0.0 all networks"
        ) from None
    if not address.is_unspecified:
        names.add(f"[{address}]" if address.version == 6 else str(address))
    elif not allowed_hosts:
        raise InputError(f"host {host} is reachable under any name; say which with --allowed-hosts, e.g. lab-pc.local")
    hosts = {f"{name}:{port}" for name in names} | {
        name.lower() if has_port(name) else f"{name.lower()}:{port}" for name in allowed_hosts
    }
    if port == 80:
        hosts |= {name.removesuffix(":80") for name in hosts}
    return Access(
        str(address), port, frozenset(hosts), None if address.is_loopback else token or secrets.token_urlsafe(24)
    )


def has_port(name: str) -> bool:
    """Whether a host name ends in a port number."""
    return name.rpartition("]")[2].rpartition(":")[2].isdigit() and ":" in name.rpartition("]")[2]
