"""Cuts of demonstrations made by the arm: refusals and their reasons, errors of the planes, loads of the joints.

    python benchmarks/arm_cuts.py [--cuts 200] [--seed 0] [--out cuts.json] [--arm FILE.urdf --flange NAME]

Demonstrations of all four categories on carrots, potatoes and courgettes are replayed, half of them with one object and
half with two. The arm is asked for every cut once. A cut that it refuses is counted and then made without the arm (its
products are laid out in the place of the fragment, and everything settles again), so that the demonstration can
continue. The benchmark ends when the arm has made as many cuts as requested. Laws checked for each cut, from its motion
and from the contacts in the scene: no joint beyond its limits; no fragment lost; no volume lost; only the blade's edge
touches the board; no part of the arm touches a fragment. Ends with exit code 1 if any law is broken or any target
missed.
"""

import argparse
import json
import sys
import time
from collections import Counter
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.spatial import ConvexHull

from cutgrammar import seeds
from cutgrammar.demonstration import CATEGORIES
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Cut, Done, Failed, Refused, Stuck
from cutgrammar.methods.controls import ReplayPlanner
from cutgrammar.motion import Execution, Motion, Phase
from cutgrammar.plugins import FOODS, load, reference_of
from cutgrammar.settings import DemonstratorSettings, KinovaSettings, Settings
from cutgrammar.trials.setups import SETUPS
from cutgrammar_sim.demonstrator.demonstrate import make_demonstration
from cutgrammar_sim.physics.bodies import Bodies
from cutgrammar_sim.physics.section import section
from cutgrammar_sim.worlds.division import divide
from cutgrammar_sim.worlds.kinova import KinovaWorld
from cutgrammar_sim.worlds.lying_fragments import parted

TARGETS = {"refused": 0.15, "plane_error_deg": 0.1, "plane_error_mm": 0.2, "volume": 1e-6}
FOODS_CUT = ("carrot", "courgette", "potato")
TOUCH = 0.5e-3
"""Parts lower than this touch the board [m]."""
EDGE = 1e-3
"""Height of the part of the blade that counts as its edge [m]."""
BRUSH = 0.6e-3
"""Depth to which the blade may enter a fragment that it does not cut; plans allow half a millimetre [m]."""
STRIDE = 12
"""Solids are compared at every sample of a motion of this stride."""
REACH = 0.45
"""A fragment farther from the middle of the board is lost [m]."""


@dataclass(frozen=True)
class Row:
    """The outcome of one cut.

    Attributes:
        trial, step, category, food: identify the cut.
        refused, failed: reason why it was not made.
        execution: how the arm made it; None where it did not.
        volume: relative error of the sum of all volumes.
        lost: number of fragments that left the board.
        broken: laws that were broken, in words.
        wall, cpu: time of the cut, with planning and settling [s].
        fragments: number of fragments after it.
    """

    trial: int
    step: int
    category: str
    food: str
    refused: str | None = None
    failed: str | None = None
    execution: Execution | None = None
    volume: float = 0.0
    lost: int = 0
    broken: tuple[str, ...] = ()
    wall: float = 0.0
    cpu: float = 0.0
    fragments: int = 0


class Contacts:
    """Counts the contacts of parts of the arm in the scene after every step."""

    def __init__(self) -> None:
        self.seen: Counter[str] = Counter()
        make_step = Bodies.step

        def step(bodies: Bodies) -> None:
            make_step(bodies)
            self.count(bodies.scene)

        self.step = step

    def count(self, scene: Any) -> None:
        """Count the contacts of the arm with an impulse."""
        for contact in scene.physx_system.get_contacts():
            links = [i for i, body in enumerate(contact.bodies) if hasattr(body, "articulation")]
            if links and any(float(np.linalg.norm(point.impulse)) > 0.0 for point in contact.points):
                link, other = contact.bodies[links[0]], contact.bodies[1 - links[0]]
                blade = type(contact.shapes[links[0]]).__name__.endswith("ConvexMesh")  # all else are capsules
                board = type(other).__name__ == "PhysxRigidStaticComponent"
                what = "blade" if blade else link.entity.name
                self.seen[f"{what} touches {'the board' if board else 'a fragment'}"] += 1

    def taken(self) -> tuple[str, ...]:
        """The contacts since the last call, without those of the blade with the board."""
        lines = tuple(f"{what} ({count} steps)" for what, count in sorted(self.seen.items()))
        self.seen.clear()
        return tuple(line for line in lines if not line.startswith("blade touches the board"))


def laws_broken(motion: Motion) -> tuple[str, ...]:
    """The laws that a motion breaks, in words."""
    broken = []
    for what, values, limits in (
        ("velocity", np.abs(motion.velocities), motion.velocity_limits),
        ("torque", np.abs(motion.torques), motion.torque_limits),
    ):
        if (values > limits).any():
            broken.append(f"a joint's {what} reached {(values / limits).max():.3f} of its limit")
    low, high = motion.position_limits.T
    if ((motion.positions < low) | (motion.positions > high)).any():
        broken.append("a joint left its range")
    for index, link in list(enumerate(motion.links))[1:]:  # all but the base, which stands beside the board
        x, y, z, w = np.moveaxis(motion.poses[::4, index, [4, 5, 6, 3]], 1, 0)
        upward = np.stack([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)], axis=1)
        heights = upward @ link.mesh.vertices.T + motion.poses[::4, index, 2:3]
        down = (heights < TOUCH).any(axis=0)
        if down.any() and not (link.name == "blade" and (link.mesh.vertices[down, 2] < EDGE).all()):
            broken.append(f"{link.name} came down to {heights.min() * 1e3:.2f} mm")
    broken += entered_by_links(motion)
    brushed = brush_of(motion)
    if brushed > BRUSH:
        broken.append(f"the blade entered another fragment by {1e3 * brushed:.2f} mm")
    return tuple(broken)


def fragments_at(motion: Motion, k: int) -> tuple[Phase, list[Fragment]]:
    """The phase of sample k, and the fragments at that time."""
    at = int(np.searchsorted([phase.first for phase in motion.phases], k, side="right")) - 1
    phase = motion.phases[at]
    if phase.poses is None:
        return phase, list(phase.fragments)
    poses = [Pose.from_vector(numbers) for numbers in phase.poses[k - phase.first]]
    return phase, [Fragment(f.shape, X_WF) for f, X_WF in zip(phase.fragments, poses, strict=True)]


def entered_by_links(motion: Motion) -> list[str]:
    """Parts of the arm and its tool, other than knife and needles, that entered a fragment's hull."""
    hulls = {id(f.shape): ConvexHull(f.mesh.vertices).equations for phase in motion.phases for f in phase.fragments}
    found: Counter[str] = Counter()
    for k in range(0, motion.phases[-1].first, STRIDE):
        _, lying = fragments_at(motion, k)
        for index, link in enumerate(motion.links):
            if link.name == "blade" or link.name.startswith("gripper"):
                continue
            corners = Pose.from_vector(motion.poses[k, index]).apply(link.mesh.vertices)
            for fragment in lying:
                if corners[:, 2].min() > fragment.p_WC[2] + 0.1:
                    continue
                equations = hulls[id(fragment.shape)]
                in_F = fragment.X_WF.inverse().apply(corners)
                if (in_F @ equations[:, :3].T + equations[:, 3] < -TOUCH).all(axis=1).any():
                    found[link.name] += 1
    return [f"{name} was in a fragment ({count} samples)" for name, count in found.items()]


def brush_of(motion: Motion) -> float:
    """Largest depth of the blade in a fragment that it does not cut [m], from the section of its plane."""
    size = np.ptp(next(link.mesh.vertices for link in motion.links if link.name == "blade"), axis=0)
    press = next(i for i, phase in enumerate(motion.phases) if phase.name == "press")
    left = {id(fragment.shape) for fragment in motion.phases[press + 1].fragments}
    deepest = 0.0
    for k in range(0, len(motion.times), STRIDE):
        (phase, lying), X_BW = fragments_at(motion, k), Pose.from_vector(motion.X_WB[k]).inverse()
        for fragment in lying:
            if phase.name != "press" or id(fragment.shape) in left:  # else it is cut
                deepest = max(deepest, entered(Fragment(fragment.shape, X_BW @ fragment.X_WF), size))
    return deepest


def entered(in_B: Fragment, size: Floats) -> float:
    """Depth of a blade of this size (3,) in a fragment given in the blade's frame B [m]."""
    corners = in_B.X_WF.apply(in_B.mesh.vertices)
    low, high = corners.min(axis=0), corners.max(axis=0)
    if low[0] > 0 or high[0] < 0 or low[1] > size[1] / 2 or high[1] < -size[1] / 2 or low[2] > size[2] or high[2] < 0:
        return 0.0
    cut = section(in_B, Plane(np.array([1.0, 0.0, 0.0]), 0.0)).reshape(-1, 3)
    sides = [cut[:, 1] + size[1] / 2, size[1] / 2 - cut[:, 1], cut[:, 2], size[2] - cut[:, 2]]
    within = np.min(sides, axis=0)  # depth of each point inside the blade's outline
    return min(float(high[0]), float(-low[0]), float(within.max(initial=0.0)))


def without_the_arm(world: KinovaWorld, cut: Cut, settings: Settings, foods: list[str]) -> list[str] | None:
    """Lay out the products of `cut` without the arm; the foods of the fragments, or None if it cuts nothing."""
    now = world.truth()
    divided = divide(now, cut, settings.world.min_share)
    if isinstance(divided, Refused):
        return None
    after: list[Any] = []
    names: list[str] = []
    gap = settings.world.blade_thickness_mm * 1e-3 * cut.plane_W.normal
    for index, fragment in enumerate(now):
        parts = parted(fragment, divided[index], gap) if index in divided else [fragment]
        after.extend(parts)
        names.extend([foods[index]] * len(parts))
    world.reset(tuple(after), names)
    return names


def volume_of(now: Configuration) -> float:
    """The sum of all volumes [m3]."""
    return sum(fragment.mesh.volume for fragment in now)


def ask(world: KinovaWorld, cut: Cut, foods: list[str], row: Row, contacts: Contacts) -> tuple[Row, list[str]]:
    """Ask the arm for one cut; the completed row, and the foods of the fragments after it."""
    before = world.truth()
    whole = volume_of(before)
    wall, cpu = time.perf_counter(), time.process_time()
    result = world.apply(cut)
    row = replace(row, wall=time.perf_counter() - wall, cpu=time.process_time() - cpu)
    touched = contacts.taken()
    if isinstance(result, Refused):
        return replace(row, refused=result.reason), foods
    if isinstance(result, Failed):
        return replace(row, failed=result.reason, broken=touched), foods
    assert isinstance(result, Done)
    motion, now = result.motion, world.truth()
    assert motion is not None
    row = replace(
        row,
        execution=result.execution,
        volume=abs(volume_of(now) / whole - 1.0),
        lost=sum(bool(np.linalg.norm(f.p_WC[:2]) > REACH or f.p_WC[2] < 0.0) for f in now),
        broken=laws_broken(motion) + touched,
        fragments=len(now),
    )
    kept = {id(fragment.shape): food for fragment, food in zip(before, foods, strict=True)}
    cut_foods = iter([foods[i] for i, f in enumerate(before) if id(f.shape) not in {id(n.shape) for n in now}])
    parent = next(cut_foods)
    return row, [kept.get(id(fragment.shape), parent) for fragment in now]


def rows_of(trial: int, settings: Settings, seed: int, contacts: Contacts) -> list[Row]:
    """All cuts of one demonstration."""
    category = CATEGORIES[trial % len(CATEGORIES)]
    setup = SETUPS["N1M1" if trial // len(CATEGORIES) % 2 == 0 else "N2M1"]
    foods_known = {name: load(reference_of(FOODS, name)) for name in FOODS_CUT}
    shown = make_demonstration(trial, setup, (category,), foods_known, seed, DemonstratorSettings())
    planner, world = ReplayPlanner(shown), KinovaWorld(settings)
    foods = list(shown.foods)
    world.reset(shown.start, foods)
    rows: list[Row] = []
    draw = partial(seeds.stream, seed, "arm cuts", trial)
    while len(world.truth()) < len(shown.goal):
        cut = planner.next_cut(world.truth(), (), (), draw(len(rows)))
        if isinstance(cut, Stuck):
            break
        nearest = min(range(len(foods)), key=lambda i: float(np.linalg.norm(world.truth()[i].p_WC - cut.p_WC[0])))
        contacts.taken()
        row, foods = ask(world, cut, foods, Row(trial, len(rows) + 1, category, foods[nearest]), contacts)
        rows.append(row)
        if row.failed is not None:
            break
        if row.refused is not None:
            laid_out = without_the_arm(world, cut, settings, foods)
            if laid_out is None:
                break
            foods = laid_out
    return rows


def table_line(name: str, rows: list[Row]) -> str:
    """A line of the table."""
    made = [(row, row.execution) for row in rows if row.execution is not None]
    if not made:
        return f"{name:22} {len(rows):5} {0:5}"
    moved = sum(done.why_moved is not None for _, done in made)
    worst = max(done.plane_error_deg for _, done in made), max(done.plane_error_mm for _, done in made)
    return (
        f"{name:22} {len(rows):5} {len(made):5} {100 * (1 - len(made) / len(rows)):7.1f}% {moved:6} "
        f"{worst[0]:9.4f} {worst[1]:8.4f} {max(done.blade_force for _, done in made):7.1f} "
        f"{max(done.torque_share for _, done in made):7.2f} {max(done.velocity_share for _, done in made):6.2f} "
        f"{np.mean([done.seconds for _, done in made]):6.1f} {np.mean([row.wall for row, _ in made]):6.2f} "
        f"{np.mean([row.cpu for row, _ in made]):6.2f}"
    )


def kind_of(reason: str) -> str:
    """A reason without its numbers, so that similar ones count together."""
    return "".join("#" if letter.isdigit() else letter for letter in reason).replace("#.#", "#").replace("##", "#")


def main() -> int:
    """Make the cuts and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cuts", type=int, default=200, help="number of cuts that the arm makes")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="a JSON file for all figures")
    parser.add_argument("--arm", type=Path, help="the URDF of another arm than the Gen3")
    parser.add_argument("--flange", default="", help="name of that URDF's link that the tool is fixed to")
    options = parser.parse_args()
    kinova = KinovaSettings() if options.arm is None else KinovaSettings(options.arm.read_text(), options.flange)
    settings, contacts = Settings(kinova=kinova), Contacts()
    rows: list[Row] = []
    trial = 0
    while sum(row.execution is not None for row in rows) < options.cuts:
        with patch.object(Bodies, "step", contacts.step):
            rows += rows_of(trial, settings, options.seed, contacts)
        trial += 1
        missed = sum(row.execution is None for row in rows)
        progress = f"\r{trial} demonstrations, {len(rows)} cuts asked for, {missed} not made"
        print(progress, end="", flush=True, file=sys.stderr)
    print(file=sys.stderr)
    made = [row.execution for row in rows if row.execution is not None]
    print(f"{'':22} asked  made refused  moved  worst deg worst mm force N torque  speed  sim s wall s  cpu s")
    for name in CATEGORIES:
        print(table_line(name, [row for row in rows if row.category == name]))
    for name in FOODS_CUT:
        print(table_line(name, [row for row in rows if row.food == name]))
    print(table_line("all", rows))
    for word, reasons in (
        ("refused", Counter(kind_of(row.refused) for row in rows if row.refused)),
        ("failed", Counter(kind_of(row.failed) for row in rows if row.failed)),
        ("moved", Counter(kind_of(done.why_moved) for done in made if done.why_moved)),
        ("broken", Counter(kind_of(law) for row in rows for law in row.broken)),
    ):
        for reason, count in reasons.most_common():
            print(f"{word}: {count} x {reason}")
    figures = {
        "asked": len(rows),
        "made": len(made),
        "refused": sum(row.refused is not None for row in rows) / len(rows),
        "failed": sum(row.failed is not None for row in rows),
        "moved": sum(done.why_moved is not None for done in made),
        "plane_error_deg": max(done.plane_error_deg for done in made),
        "plane_error_mm": max(done.plane_error_mm for done in made),
        "volume": max(row.volume for row in rows),
        "lost": sum(row.lost for row in rows),
        "broken": sum(len(row.broken) for row in rows),
        "wall": float(np.mean([row.wall for row in rows if row.execution])),
        "cpu": float(np.mean([row.cpu for row in rows if row.execution])),
    }
    print(json.dumps(figures))
    if options.out is not None:
        options.out.write_text(json.dumps({"seed": options.seed, **figures, "cuts": [asdict(row) for row in rows]}))
    kept = all(figures[name] <= limit for name, limit in TARGETS.items())
    return 0 if kept and not figures["lost"] and not figures["failed"] and not figures["broken"] else 1


if __name__ == "__main__":
    sys.exit(main())
