"""Makes the arms' reference values from their URDF with an oracle that is not ours: Pinocchio.

Pinocchio (on PyPI as `pin`) must not enter the project's environment, for SAPIEN changes its own inverse kinematics
when it finds it. So this runs in one of its own:

    python -m venv oracle && oracle/bin/pip install pin==4.1.0
    oracle/bin/python benchmarks/arm_reference.py GEN3-7DOF-VISION_ARM_URDF_V12.urdf end_effector_link 1000 \\
        tests/data/kinova_gen3_reference.npz
    oracle/bin/python benchmarks/arm_reference.py tests/data/ur5e.urdf flange 50 tests/data/ur5e_reference.npz

Kinova's description is that of github.com/Kinovarobotics/ros_kortex, commit 6cd75d45 (2024-03-19). A table holds, for
n joints and t postures:
    postures (t, n) [rad]
    flange (t, 7): position [m] and quaternion w x y z of the flange in the root
    gravity (t, n): torques [N m]
    velocities, accelerations, torques (t / 5, n): inverse dynamics of the first fifth
    jacobian (t / 20, 6, n): of the flange's origin for the first ones (velocity, angular velocity, axes of the root)
    masses (k,) [kg], centres (k, 3) [m], inertias (k, 3, 3) about the centres [kg m2]: as the text gives them
"""

import sys
import xml.etree.ElementTree as ElementTree

import numpy as np
import pinocchio


def main(description: str, flange: str, count: str, out: str) -> None:
    """Write the table of `count` postures to `out`."""
    model = pinocchio.buildModelFromUrdf(description)
    data = model.createData()
    frame = model.getFrameId(flange)
    t, n = int(count), model.nv
    rng = np.random.default_rng(2024)
    low, high = np.full(n, -np.pi), np.full(n, np.pi)
    for i, joint in enumerate(list(model.joints)[1:]):
        if joint.nq == 1:
            low[i] = max(low[i], model.lowerPositionLimit[joint.idx_q])
            high[i] = min(high[i], model.upperPositionLimit[joint.idx_q])
    postures = rng.uniform(low, high, (t, n))
    velocities, accelerations = rng.uniform(-1.2, 1.2, (t // 5, n)), rng.uniform(-5.0, 5.0, (t // 5, n))
    table: dict[str, list[np.ndarray]] = {name: [] for name in ("flange", "gravity", "torques", "jacobian")}
    for k, q in enumerate(postures):
        turned = as_pinocchio(model, q)
        pinocchio.framesForwardKinematics(model, data, turned)
        pose = data.oMf[frame]
        x, y, z, w = pinocchio.Quaternion(pose.rotation).coeffs()
        table["flange"].append(np.concatenate([pose.translation, [w, x, y, z]]))
        table["gravity"].append(pinocchio.computeGeneralizedGravity(model, data, turned).copy())
        if k < t // 5:
            table["torques"].append(pinocchio.rnea(model, data, turned, velocities[k], accelerations[k]).copy())
        if k < t // 20:
            axes = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
            table["jacobian"].append(pinocchio.computeFrameJacobian(model, data, turned, frame, axes).copy())
    masses, centres, inertias = zip(*inertias_of(description), strict=True)
    np.savez_compressed(
        out,
        postures=postures,
        velocities=velocities,
        accelerations=accelerations,
        masses=masses,
        centres=centres,
        inertias=inertias,
        **{name: np.array(rows) for name, rows in table.items()},
    )


def as_pinocchio(model: "pinocchio.Model", q: np.ndarray) -> np.ndarray:
    """The posture as Pinocchio has it: cosine and sine for a joint that turns without end."""
    numbers: list[float] = []
    for joint, angle in zip(list(model.joints)[1:], q, strict=True):
        numbers += [np.cos(angle), np.sin(angle)] if joint.nq == 2 else [angle]
    return np.array(numbers)


def inertias_of(description: str) -> list[tuple[float, list[float], list[list[float]]]]:
    """Mass, centre and inertia of every link with a mass, in the order of the file, straight from its text."""
    found = []
    for inertial in ElementTree.parse(description).iter("inertial"):
        mass = float(inertial.find("mass").get("value"))
        if mass > 0.0:
            six = inertial.find("inertia")
            xx, xy, xz, yy, yz, zz = (float(six.get(name)) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
            centre = [float(number) for number in inertial.find("origin").get("xyz").split()]
            found.append((mass, centre, [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    return found


if __name__ == "__main__":
    main(*sys.argv[1:])
