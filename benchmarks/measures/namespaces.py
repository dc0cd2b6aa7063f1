"""A Ray cluster on one Linux machine: each node has a network namespace, and so an address, of its own. Needs root."""

import contextlib
import os
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

PORT = 6379
"""Of the head."""
JOIN_SECONDS = 120.0
"""Time limit for a node's start [s]."""
HEAD_PARTS = ("gcs_server", "raylet")
WORKER_PARTS = ("raylet",)


def ip(*words: str) -> str:
    """What `ip WORDS` prints."""
    return subprocess.run(["ip", *words], check=True, capture_output=True, text=True).stdout


@dataclass
class Node:
    """One node of the cluster.

    Attributes:
        number: of the node; node 0 is the head.
        environment: of its processes.
        cpus: CPUs that it offers.
        log: file that the output of `ray start` is appended to.
        network: number of the cluster's network; two clusters on one machine have different ones.
        is_cut_off: whether it reaches no other node; what runs on it runs on.
    """

    number: int
    environment: Mapping[str, str]
    cpus: int
    log: Path
    network: int = 7
    is_cut_off: bool = field(default=False, init=False)
    _starter: subprocess.Popen[bytes] | None = field(default=None, init=False)

    @property
    def name(self) -> str:
        """Of its namespace."""
        return f"cutgrammar-{self.network}-{self.number}"

    @property
    def address(self) -> str:
        """Its IPv4 address."""
        return f"10.213.{self.network}.{self.number + 1}"

    def run(self, words: Sequence[str], **more: object) -> subprocess.Popen[bytes]:
        """Start a program within the node's namespace; the process is that of the program."""
        command = ["ip", "netns", "exec", self.name, *words]
        return subprocess.Popen(command, env=dict(self.environment), start_new_session=True, **more)  # type: ignore[call-overload, no-any-return]

    def start(self) -> None:
        """Start Ray on this node and return at once."""
        place = ["--head", f"--port={PORT}", "--include-dashboard=false"]
        if self.number:
            place = [f"--address=10.213.{self.network}.1:{PORT}"]
        ray = [sys.executable, "-m", "ray.scripts.scripts", "start", "--block", f"--num-cpus={self.cpus}"]
        with self.log.open("ab") as log:
            more = {"stdout": log, "stderr": log, "stdin": subprocess.DEVNULL}
            self._starter = self.run([*ray, f"--node-ip-address={self.address}", *place], **more)

    def processes(self) -> dict[int, str]:
        """Process id -> command line of every process in the namespace."""
        found = {}
        for pid in map(int, ip("netns", "pids", self.name).split()):
            with contextlib.suppress(OSError):
                line = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ")
                found[pid] = line.decode(errors="replace").strip()
        return found

    def pids(self, program: str) -> list[int]:
        """Processes whose first word ends with `program`, or starts with it for the names that Ray gives ("ray::")."""
        words = {pid: (line.split() or [""])[0] for pid, line in self.processes().items()}
        return sorted(pid for pid, word in words.items() if word.endswith(program) or word.startswith(program))

    def is_alive(self) -> bool:
        """Whether `ray start` still runs, as it does as long as all parts of the node run."""
        return self._starter is not None and self._starter.poll() is None

    def cut_off(self, interface: bool = False) -> None:
        """Unplug the node's cable, or take down its interface, so that it does not reach its own address either."""
        if interface:
            ip("-n", self.name, "link", "set", f"cutg{self.network}-{self.number}i", "down")
        else:
            ip("link", "set", f"cutg{self.network}-{self.number}o", "down")
        self.is_cut_off = True

    def connect(self) -> None:
        """Undo `cut_off`."""
        ip("-n", self.name, "link", "set", f"cutg{self.network}-{self.number}i", "up")
        ip("link", "set", f"cutg{self.network}-{self.number}o", "up")
        self.is_cut_off = False

    def end(self, but: Sequence[int] = ()) -> None:
        """Kill every process of the node but those given."""
        for pid in set(self.processes()) - set(but):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        if self._starter is not None:
            self._starter.wait()


@contextlib.contextmanager
def nodes(count: int, cpus: int, folder: Path, network: int = 7) -> Iterator[list[Node]]:
    """`count` nodes that are not started yet, with a token of their own; all that runs on them ends with the block.

    Args:
        count: number of nodes.
        cpus: CPUs that each offers.
        folder: of the logs of `ray start`.
        network: number of the cluster's network, below 256.
    """
    bridge = f"cutgrammar-br{network}"
    token = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}
    quiet = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0", "OMP_NUM_THREADS": "1"}
    path = os.pathsep.join(["/usr/sbin", os.environ.get("PATH", "")])
    environment = {**os.environ, **quiet, **token, "PATH": path}
    made = [Node(number, environment, cpus, folder / f"node-{number}.log", network) for number in range(count)]
    ip("link", "add", bridge, "type", "bridge")  # fails where another cluster has this network, which then stays
    try:
        ip("link", "set", bridge, "up")
        for node in made:
            inner, outer = f"cutg{network}-{node.number}i", f"cutg{network}-{node.number}o"
            ip("netns", "add", node.name)
            ip("link", "add", outer, "type", "veth", "peer", "name", inner)
            ip("link", "set", outer, "master", bridge, "up")
            ip("link", "set", inner, "netns", node.name)
            ip("-n", node.name, "addr", "add", f"{node.address}/24", "dev", inner)
            ip("-n", node.name, "link", "set", inner, "up")
            ip("-n", node.name, "link", "set", "lo", "up")
        yield made
    finally:
        for node in made:
            with contextlib.suppress(subprocess.CalledProcessError):
                node.end()
                ip("netns", "del", node.name)
        ip("link", "del", bridge)


def start(cluster: Sequence[Node]) -> None:
    """Start all nodes, the head first, and wait until all have joined.

    Raises:
        TimeoutError: they have not within `JOIN_SECONDS` each.
    """
    for count, node in enumerate(cluster, 1):
        over = time.monotonic() + JOIN_SECONDS
        while joined(cluster) < count:
            if time.monotonic() > over:
                raise TimeoutError(f"node {node.number} has not joined within {JOIN_SECONDS:.0f} s; see {node.log}")
            if not node.is_alive():
                node.start()
            time.sleep(1.0)


def joined(cluster: Sequence[Node]) -> int:
    """Number of nodes that are alive, as the head says; 0 if it does not answer."""
    words = [sys.executable, "-c", _COUNT, f"{cluster[0].address}:{PORT}"]
    process = cluster[0].run(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    return int(process.communicate()[0].decode().strip() or 0)


_COUNT = """
import sys
from ray._raylet import GcsClient
nodes = GcsClient(address=sys.argv[1]).get_all_node_info(timeout=10)
print(sum(node.state == 0 for node in nodes.values()))
"""
