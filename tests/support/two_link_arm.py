"""A synthetic robot for tests of displays and files: two links in a vertical plane that carry a knife."""

import numpy as np
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.fragment import Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar.motion import Link, Motion, Phase
from simple_shapes import box_mesh


def two_link_motion(before, after, p_WE, carried=None, turned_deg=0.0, hertz=240):
    """A two-link arm in a vertical plane moves a hanging knife to a place, presses it to the board and returns home.

    Args:
        before, after: the configurations before and after the cut.
        p_WE: (3,) final position of the middle of the edge [m].
        carried: (index, shift) of a fragment of `before` that is carried first; it is then cut at `p_WE`.
        turned_deg: angle by which it is rotated about the vertical meanwhile [degrees].
        hertz: samples per second.
    """

    def box(x, y, z, middle):
        return box_mesh(x, y, z).moved(Pose(np.eye(3), middle))

    reach, hang = 0.4, 0.16
    shoulder, home = np.array([-0.45, 0.0, 0.1]), np.array([-0.15, 0.0, 0.45])
    down, up = np.array([p_WE[0], 0.0, p_WE[2] + hang]), np.array([0.0, 0.0, 0.04])
    above = down + 2 * up
    path = [("transit", 1.0, home, above), ("approach", 0.5, above, down + up), ("press", 0.5, down + up, down)]
    path += [("retreat", 0.5, down, above), ("transit", 1.0, above, home)]
    resting = before
    if carried is not None:
        index, shift = carried
        over = before[index].p_WC * [1.0, 0.0, 1.0] + [0.0, 0.0, hang + 0.05]
        target = over + np.asarray(shift) * [1.0, 0.0, 1.0]
        first = [("transit", 1.0, home, over), ("pick", 0.3, over, over), ("carry", 1.0, over, target)]
        path = [*first, ("place", 0.3, target, target), ("transit", 0.6, target, above), *path[1:]]
        turn = Rotation.from_euler("z", turned_deg, degrees=True)

        def carried_fragments(share):
            part = Rotation.from_rotvec(share * turn.as_rotvec()).as_matrix()
            f, lift = before[index], 0.06 * np.sin(np.pi * share)
            X_CF = Pose(np.eye(3), -f.p_WC) @ f.X_WF
            X_WC = Pose(part, f.p_WC + share * np.asarray(shift) + [0.0, 0.0, lift])
            return (*before[:index], Fragment(f.shape, X_WC @ X_CF), *before[index + 1 :])

        resting = carried_fragments(1.0)
    path.append(("settle", 0.4, home, home))
    wrist, phases, done = [], [], False
    for name, seconds, a, b in path:
        samples = round(seconds * hertz)
        ease = (1 - np.cos(np.pi * np.arange(samples) / samples)) / 2
        first, poses = sum(map(len, wrist)), None
        if name == "carry":
            poses = np.array([[f.X_WF.to_vector() for f in carried_fragments(share)] for share in ease])
        done = done or name == "retreat"
        fragments = after if done else before if carried and name in ("pick", "carry") else resting
        fragments = before if carried and first == 0 else fragments
        if name == "settle":
            drop = 0.002 * (1 - ease)[:, None] * [0.0, 0.0, 1.0]
            poses = np.array([[f.X_WF.to_vector() for f in after]] * samples)
            poses[:, :, :3] += drop[:, None]
        phases.append(Phase(name, first, fragments, poses))
        wrist.append(a + ease[:, None] * (b - a))
    wrist = np.concatenate(wrist)
    away = wrist - shoulder
    far = np.linalg.norm(away, axis=1)
    bend = np.arccos(np.clip(far / (2 * reach), -1, 1))
    upper = np.arctan2(away[:, 2], away[:, 0]) + bend
    positions = np.stack([upper, -2 * bend], axis=1)
    times = np.arange(len(wrist)) / hertz
    velocities = np.gradient(positions, times, axis=0)
    links = (
        Link("base", box(0.12, 0.12, 0.15, [0.0, 0.0, -0.075])),
        Link("upper arm", box(reach, 0.07, 0.07, [reach / 2, 0.0, 0.0])),
        Link("forearm", box(reach, 0.06, 0.06, [reach / 2, 0.0, 0.0])),
        Link("knife", box(0.002, 0.2, 0.08, [0.0, 0.0, 0.04])),
        Link("handle", box(0.03, 0.03, 0.08, [0.0, 0.0, 0.12])),
    )
    elbow = shoulder + reach * np.stack([np.cos(upper), 0 * upper, np.sin(upper)], axis=1)
    fore = upper - 2 * bend

    def placed(p_W, about_y):
        turns = Rotation.from_euler("y", np.broadcast_to(-about_y, len(wrist))[:, None]).as_quat(scalar_first=True)
        return np.hstack([np.broadcast_to(p_W, (len(wrist), 3)), turns])

    edge = placed(wrist - [0.0, 0.0, hang], np.array(0.0))
    force = np.zeros(len(wrist))
    press = next(p for p in phases if p.name == "press").first
    force[press : press + hertz // 2] = 25.0 * np.sin(np.pi * np.arange(hertz // 2) / (hertz // 2))
    torques = np.stack([19.6 * np.cos(upper) + 0.2 * force, 4.9 * np.cos(fore) + 0.1 * force], axis=1)
    zero = np.zeros((len(wrist), 1))
    return Motion(
        times=times,
        joints=("shoulder", "elbow"),
        positions=positions,
        velocities=velocities,
        torques=torques,
        position_limits=np.array([[-np.inf, np.inf], [-2.8, 2.8]]),
        velocity_limits=np.array([4.0, 6.0]),
        torque_limits=np.array([39.0, 20.0]),
        wrench_W=np.hstack([zero, zero, force[:, None], zero, zero, zero]),
        blade_force=force,
        links=links,
        poses=np.stack(
            [placed(shoulder, np.array(0.0)), placed(shoulder, upper), placed(elbow, fore), edge, edge], axis=1
        ),
        X_WB=edge,
        phases=tuple(phases),
    )
