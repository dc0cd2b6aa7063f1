"""A short trial written by hand: a stick is cut into four fragments, with a refusal, parse trees and a score."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from cutgrammar.events import CutMade, CutRefused, Planned, Scored
from cutgrammar.geometry.comparison.overlap import Solid, best_match
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.geometry.slicing import slice_mesh
from cutgrammar.interfaces import Cut, Explanation, Sighted, TreeNode
from cutgrammar.motion import Execution


def stick():
    mesh = trimesh.creation.cylinder(0.015, 0.16, sections=48)
    v = mesh.vertices[:, [2, 0, 1]]
    v = v * np.stack([np.ones(len(v)), 1 - 2.5 * v[:, 0], 1 - 2.5 * v[:, 0]], axis=1)
    return Mesh(v, mesh.faces)


def cut_at(fragments, index, x, apart=0.0):
    """The fragments after a cut of number `index` across x; products stay in place or move `apart`."""
    whole = fragments[index]
    products = slice_mesh(whole.mesh, Plane.through(np.array([x, 0, 0]), np.array([1.0, 0, 0]))).products
    signs = np.linspace(1, -1, len(products))
    made = [
        Fragment(mesh, Pose(np.eye(3), whole.X_WF.position + np.array([apart * sign, 0, 0])))
        for mesh, sign in zip(products, signs, strict=True)
    ]
    return (*fragments[:index], *fragments[index + 1 :], *made)


def tree_of(now, goal_types):
    """A parse tree with a node for each current fragment; the last of them is expanded until there are four leaves."""
    nodes = [TreeNode(None, None), *(TreeNode(0, goal_types[i], now=i, goal=i) for i in range(now - 1))]
    nodes.append(TreeNode(0, 5, now=now - 1))
    left, parent, goal = 4 - (now - 1), now, now - 1
    while left > 1:
        nodes.append(TreeNode(parent, goal_types[goal], goal=goal))
        last = left == 2
        nodes.append(TreeNode(parent, 2 if last else 4, goal=3 if last else None))
        parent, goal, left = len(nodes) - 1, goal + 1, left - 1
    return tuple(nodes)


@pytest.fixture(scope="session")
def story():
    """(start, goal, events) of the trial."""
    lying = Pose(np.eye(3), np.array([0.0, 0.0, 0.02]))
    start = (Fragment(stick(), lying),)
    goal = start
    for i, x in enumerate((0.04, 0.0, -0.04)):
        goal = cut_at(goal, len(goal) - 1 if i else 0, x)
    rng = np.random.default_rng(0)
    now, events = start, []
    for step, x in enumerate((0.037, 0.004, -0.043), start=1):
        plane = Plane.through(np.array([x, 0, 0.02]), np.array([1.0, 0, 0.0]))
        history = tuple(np.maximum.accumulate(rng.normal(-60 + 12 * step, 8, 60)))
        why = Explanation(tree_of(step, (0, 0, 1, 2)), "c5 -> c0 c4", -3.2, -20.5, -4.1, history, 60, 3)
        target = now[-1]
        cut = Cut(plane, target.p_WC[None], why)
        events.append(Planned(step, 0, cut, 0.31))
        if step == 2:
            events += [CutRefused(step, 0, "would cut a neighbour"), Planned(step, 1, cut, 0.28)]
        now = cut_at(now, len(now) - 1, x, apart=0.004)
        events.append(CutMade(step, 2, now))
    match = best_match([Solid(f.mesh) for f in now], [Solid(f.mesh) for f in goal])
    pairs = tuple((int(i), int(j), float(v)) for i, j, v in zip(match.reached, match.goal, match.ious, strict=True))
    events.append(Scored({"iou_strict": match.strict, "iou": match.mean}, len(now), len(goal), pairs))
    return start, goal, events


@pytest.fixture(scope="session")
def arm_story(story, make_motion):
    """The same trial with an arm and cameras: before its second cut, the arm carries and turns the fragment."""
    start, goal, events = story
    events_with_arm, now = [], start
    for event in events:
        if isinstance(event, Planned) and event.attempt == 0:
            seen = [f.X_WF.apply(sample_surface(f.mesh, 5000).points) for f in now]
            owners = np.repeat(np.arange(len(now)), 5000)
            labels = np.where(np.arange(len(owners)) % 50 == 0, -1, owners)
            events_with_arm.append(Sighted(event.step, np.concatenate(seen), labels, owners, now))
        if isinstance(event, CutMade):
            after, second = event.configuration, event.step == 2
            shift = np.array([0.02, 0.05, 0.0])
            if second:  # what was carried to another place and turned is cut there
                turned = Pose(Rotation.from_euler("z", 40, degrees=True).as_matrix(), now[-1].p_WC + shift)
                X_WW = turned @ Pose(np.eye(3), -now[-1].p_WC)
                kept, made = after[:-2], after[-2:]
                after = (*kept, *(Fragment(f.shape, X_WW @ f.X_WF) for f in made))
            place = 0.5 * (after[-1].p_WC + after[-2].p_WC) * [1.0, 1.0, 0.0]
            motion = make_motion(now, after, place, (len(now) - 1, shift) if second else None, 40.0)
            why = "a neighbour lay in the blade's way" if second else None
            moved = (40.0, 0.0538) if second else (0.0, 0.0)
            execution = Execution(why, *moved, 0.012, 0.034, float(motion.times[-1]), 25.0, 0.61, 0.43, True)
            now = after
            event = CutMade(event.step, event.products, after, execution, motion)
        events_with_arm.append(event)
    return start, goal, events_with_arm
