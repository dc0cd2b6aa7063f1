"""Which nodes of a cluster do no work any more, since workers fail there: without a package, or with a full disk."""

import sys
from collections import Counter

import ray
from ray._private import state

from cutgrammar_workers.worker_actor import Place

MAX_STRIKES = 3
"""A node on which so many tasks in a row met faults of the machine, or so many workers died at start, is set aside."""


class Nodes:
    """The nodes that were set aside; Ray places no further actor there."""

    def __init__(self) -> None:
        self._aside: set[str] = set()
        self._strikes: Counter[str] = Counter()

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

    def strike(self, place: Place, reason: str) -> bool:
        """Count a fault of the machine on a node; True if the node is set aside for it."""
        self._strikes[place.node] += 1
        return self._strikes[place.node] >= MAX_STRIKES and self.set_aside(place, reason)

    def clear(self, place: Place) -> None:
        """A task has ended well on a node."""
        self._strikes[place.node] = 0

    def _others(self, node: str) -> list[str]:
        """Other nodes that could work."""
        alive = [found for found in ray.nodes() if found["Alive"] and found["Resources"].get("CPU", 0) > 0]
        return [found["NodeID"] for found in alive if found["NodeID"] not in {node, *self._aside}]


def place_of(handle: object) -> Place | None:
    """Where Ray placed an actor, which may be dead; None if it does not know."""
    try:
        found = state.actors(handle._actor_id.hex())  # type: ignore[attr-defined]
        node = str(found["Address"]["NodeID"])
        host = next((n["NodeManagerHostname"] for n in ray.nodes() if n["NodeID"] == node), node)
        return Place(node, str(host), int(found.get("Pid") or 0)) if node.strip("f") else None
    except (KeyError, TypeError, AttributeError, RuntimeError):
        return None
