"""Which nodes of a cluster do no work any more.

Workers fail there (without a package, with a full disk), or the node has died or is cut off from the others.
"""

import sys
import time
from collections import Counter
from typing import Any

import ray
from ray._private import state
from ray.exceptions import ActorDiedError, NodeDiedError, OutOfMemoryError, RayError

from cutgrammar_workers.lifeline import is_listening
from cutgrammar_workers.worker_actor import Place

MAX_STRIKES = 3
"""A node on which so many tasks in a row met faults of the machine, or so many workers died at start, is set aside."""
HANG = 2
"""A worker that hangs while it is built counts as so many faults: each takes long, and a second one is enough."""

SILENT_SECONDS = 20.0
"""A node that did not answer is not asked again for so long [s]; each of its workers would wait for that."""


class Nodes:
    """The nodes that were set aside; Ray places no further actor there."""

    def __init__(self) -> None:
        self._aside: set[str] = set()
        self._strikes: Counter[str] = Counter()
        self._lost: set[str] = set()
        self._silent: dict[str, float] = {}

    @property
    def selector(self) -> dict[str, str]:
        """Ray's label selector of the other nodes."""
        return {"ray.io/node-id": f"!in({','.join(sorted(self._aside))})"} if self._aside else {}

    def set_aside(self, place: Place, reason: str) -> bool:
        """Set a node aside, and say so; or return False if no other node is left to work."""
        if place.node in self._aside:
            return True
        if not self._others(place.node):
            return False
        self._aside.add(place.node)
        print(f"node {place.host} ({place.node[:12]}) is set aside, the others go on: {reason}", file=sys.stderr)
        return True

    def strike(self, place: Place, reason: str, weight: int = 1) -> bool:
        """Count a fault of the machine on a node; True if the node is set aside for it."""
        self._strikes[place.node] += weight
        return self.is_struck(place) and self.set_aside(place, reason)

    def is_struck(self, place: Place) -> bool:
        """Whether a node has had too many faults in a row, be it the last one or not."""
        return self._strikes[place.node] >= MAX_STRIKES

    def clear(self, place: Place) -> None:
        """A task has ended well on a node."""
        self._strikes[place.node] = 0
        self._lost.discard(place.node)
        self._silent.pop(place.node, None)

    def is_lost(self, place: Place, error: RayError) -> bool:
        """Whether a node whose actor died has died or does not answer, which is told once."""
        if not has_node_died(error):
            return self.is_cut_off(place)
        self._tell_lost(place, "has died")
        return True

    def is_cut_off(self, place: Place) -> bool:
        """Whether a node does not answer this machine, which is told once; Ray finds that out after a minute."""
        if time.monotonic() - self._silent.get(place.node, -SILENT_SECONDS) < SILENT_SECONDS:
            return True
        facts = _facts_of(place.node)
        if facts is None or is_listening((facts["NodeManagerAddress"], facts["NodeManagerPort"])):
            return False
        self._silent[place.node] = time.monotonic()
        self._tell_lost(place, "does not answer")
        return True

    def _tell_lost(self, place: Place, reason: str) -> None:
        """Say once what became of a node."""
        if place.node in self._lost:
            return
        self._lost.add(place.node)
        facts = _facts_of(place.node)
        address = "" if facts is None else f" at {facts['NodeManagerAddress']}"
        print(f"node {place.host}{address} ({place.node[:12]}) {reason}: its tasks are repeated", file=sys.stderr)

    def _others(self, node: str) -> list[str]:
        """Other nodes that could work."""
        alive = [found for found in ray.nodes() if found["Alive"] and found["Resources"].get("CPU", 0) > 0]
        return [found["NodeID"] for found in alive if found["NodeID"] not in {node, *self._aside}]


def _facts_of(node: str) -> dict[str, Any] | None:
    """What Ray knows of a node."""
    return next((found for found in ray.nodes() if found["NodeID"] == node), None)


def has_node_died(error: RayError) -> bool:
    """Whether an actor died with its node."""
    return isinstance(error, NodeDiedError) or (isinstance(error, ActorDiedError) and "its node has died" in str(error))


def is_death_by_machine(error: RayError) -> bool:
    """Whether an actor died with its node, by preemption, or because Ray's monitor found the memory full."""
    preempted = isinstance(error, ActorDiedError) and error.preempted
    return preempted or isinstance(error, OutOfMemoryError) or has_node_died(error)


def place_of(handle: object) -> Place | None:
    """Where Ray placed an actor, which may be dead; None if it does not know."""
    try:
        found = state.actors(handle._actor_id.hex())  # type: ignore[attr-defined]
        node = str(found["Address"]["NodeID"])
        host = next((n["NodeManagerHostname"] for n in ray.nodes() if n["NodeID"] == node), node)
        return Place(node, str(host), int(found.get("Pid") or 0)) if node.strip("f") else None
    except (KeyError, TypeError, AttributeError, RuntimeError):
        return None
