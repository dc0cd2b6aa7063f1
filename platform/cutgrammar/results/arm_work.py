"""How an arm carried out the cuts of many trials, read from their records."""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from cutgrammar.trials.record import Record


@dataclass(frozen=True)
class ArmWork:
    """The cuts that an arm made for one method.

    Attributes:
        world, perception, method: by name.
        cuts: number of cuts made.
        moved: number of them for which the fragment was moved.
        turned: number of those for which it was turned by a degree or more.
        cleared: number of cuts before which others were set aside that lay on the fragment.
        plane_error_deg, plane_error_mm: the largest of all cuts [degrees, mm].
        torque_share, velocity_share: the largest of all joints and cuts, as shares of the limits.
        blade_force: the largest of all cuts [N].
        broken: number of cuts in which a limit was exceeded.
        seconds: simulated, of all cuts together [s].
        refused: ((reason, count), ...), the most frequent first; numbers in reasons are left out, so that equal kinds
            count together.
        failed: the same for cuts that ended their trial.
    """

    world: str
    perception: str
    method: str
    cuts: int
    moved: int
    turned: int
    cleared: int
    plane_error_deg: float
    plane_error_mm: float
    torque_share: float
    velocity_share: float
    blade_force: float
    broken: int
    seconds: float
    refused: tuple[tuple[str, int], ...]
    failed: tuple[tuple[str, int], ...]


def arm_work(records: Iterable[Record]) -> list[ArmWork]:
    """The work of an arm for each method and world; worlds in which no arm made a cut are left out."""
    groups: dict[tuple[str, str, str], list[Record]] = {}
    for record in records:
        groups.setdefault((record.key.world, record.key.perception, record.key.method), []).append(record)
    return [work for names, group in sorted(groups.items()) if (work := _work(names, group)) is not None]


def _work(names: tuple[str, str, str], records: list[Record]) -> ArmWork | None:
    events = [event for record in records for event in record.events]
    made = [event["execution"] for event in events if event["event"] == "CutMade" and "execution" in event]
    if not made:
        return None
    moved = [cut for cut in made if cut["why_moved"] is not None]
    return ArmWork(
        *names,
        cuts=len(made),
        moved=len(moved),
        turned=sum(cut["turned_deg"] >= 1.0 for cut in moved),
        cleared=sum(cut.get("set_aside", 0) > 0 for cut in made),  # older records do not say it
        plane_error_deg=max(cut["plane_error_deg"] for cut in made),
        plane_error_mm=max(cut["plane_error_mm"] for cut in made),
        torque_share=max(cut["torque_share"] for cut in made),
        velocity_share=max(cut["velocity_share"] for cut in made),
        blade_force=max(cut["blade_force"] for cut in made),
        broken=sum(not cut["limits_kept"] for cut in made),
        seconds=sum(cut["seconds"] for cut in made),
        refused=_counted(event["reason"] for event in events if event["event"] == "CutRefused"),
        failed=_counted(event["reason"] for event in events if event["event"] == "CutFailed"),
    )


def _counted(reasons: Iterable[str]) -> tuple[tuple[str, int], ...]:
    counts = Counter(re.sub(r"\d+(\.\d+)?", "…", reason) for reason in reasons)
    return tuple(sorted(counts.items(), key=lambda pair: (-pair[1], pair[0])))
