"""Reference values of an arm, straight from its URDF file: a table for the tests, or a comparison with our Gen3.

    python benchmarks/arm_reference.py GEN3-7DOF-VISION_ARM_URDF_V12.urdf end_effector_link
    python benchmarks/arm_reference.py GEN3-7DOF-VISION_ARM_URDF_V12.urdf end_effector_link --postures 1000 \\
        --out tests/data/kinova_gen3_reference.npz
    python benchmarks/arm_reference.py tests/data/ur5e.urdf flange --postures 50 --out tests/data/ur5e_reference.npz

Kinova's description is in github.com/Kinovarobotics/ros_kortex, commit 6cd75d45 (2024-03-19), kortex_description.
Without --out, the script compares it with the figures of `gen3` and ends with exit code 1 if any differs by more than
1e-9. A table holds, for n joints and t postures:
    postures (t, n) [rad]
    flange (t, 7): position [m] and quaternion w x y z of the flange in the root
    gravity (t, n): torques [N m]
    velocities, accelerations, torques (t / 5, n): inverse dynamics of the first fifth
    jacobian (t / 20, 6, n): of the flange's origin for the first ones (velocity, angular velocity, axes of the root)
    masses (k,) [kg], centres (k, 3) [m], inertias (k, 3, 3) about the centres [kg m2]: as the text gives them
The tables in the repository were made with Pinocchio 4.1.0.
"""

import argparse
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio

from cutgrammar_sim.arm.robot.dynamics import gravity_torques, inverse_dynamics
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.kinematics import flange_poses, jacobian


def table_of(urdf: Path, flange: str, count: int) -> dict[str, Any]:
    """The reference values of `count` postures; see above."""
    model = pinocchio.buildModelFromUrdf(str(urdf))
    data = model.createData()
    frame = model.getFrameId(flange)
    t, n = count, model.nv
    rng = np.random.default_rng(2024)
    low, high = np.full(n, -np.pi), np.full(n, np.pi)
    for i, joint in enumerate(list(model.joints)[1:]):
        if joint.nq == 1:
            low[i] = max(low[i], model.lowerPositionLimit[joint.idx_q])
            high[i] = min(high[i], model.upperPositionLimit[joint.idx_q])
    postures = rng.uniform(low, high, (t, n))
    velocities, accelerations = rng.uniform(-1.2, 1.2, (t // 5, n)), rng.uniform(-5.0, 5.0, (t // 5, n))
    rows: dict[str, list[Any]] = {name: [] for name in ("flange", "gravity", "torques", "jacobian")}
    for k, angles in enumerate(postures):
        q = as_pinocchio(model, angles)
        pinocchio.framesForwardKinematics(model, data, q)
        pose = data.oMf[frame]
        x, y, z, w = pinocchio.Quaternion(pose.rotation).coeffs()
        rows["flange"].append(np.concatenate([pose.translation, [w, x, y, z]]))
        rows["gravity"].append(pinocchio.computeGeneralizedGravity(model, data, q).copy())
        if k < t // 5:
            rows["torques"].append(pinocchio.rnea(model, data, q, velocities[k], accelerations[k]).copy())
        if k < t // 20:
            axes = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
            rows["jacobian"].append(pinocchio.computeFrameJacobian(model, data, q, frame, axes).copy())
    masses, centres, inertias = zip(*inertias_of(urdf), strict=True)
    return {
        "postures": postures,
        "velocities": velocities,
        "accelerations": accelerations,
        "masses": np.array(masses),
        "centres": np.array(centres),
        "inertias": np.array(inertias),
        **{name: np.array(values) for name, values in rows.items()},
    }


def as_pinocchio(model: Any, angles: Any) -> Any:
    """The posture as Pinocchio's parser has it: cosine and sine for a joint without limits."""
    numbers: list[float] = []
    for joint, angle in zip(list(model.joints)[1:], angles, strict=True):
        numbers += [np.cos(angle), np.sin(angle)] if joint.nq == 2 else [angle]
    return np.array(numbers)


def inertias_of(urdf: Path) -> list[tuple[float, list[float], list[list[float]]]]:
    """Mass, centre and inertia of every link with a mass, in the order of the file, straight from its text."""
    found = []
    for inertial in ElementTree.parse(urdf).iter("inertial"):
        mass = float(attribute(inertial.find("mass"), "value"))
        if mass > 0.0:
            six = inertial.find("inertia")
            xx, xy, xz, yy, yz, zz = (
                float(attribute(six, name)) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
            )
            centre = [float(number) for number in attribute(inertial.find("origin"), "xyz").split()]
            found.append((mass, centre, [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    return found


def attribute(element: ElementTree.Element | None, name: str) -> str:
    """An attribute's text, empty where there is none."""
    return "" if element is None else element.get(name, "")


def differences(urdf: Path, flange: str) -> dict[str, float]:
    """The largest differences between our Gen3 and a description of it."""
    arm, table = gen3(), table_of(urdf, flange, 200)
    q, first = table["postures"], table["postures"][: len(table["torques"])]
    X, turns = flange_poses(arm, q), table["flange"][:, [4, 5, 6, 3]]
    rotations = np.array([pinocchio.Quaternion(turn).toRotationMatrix() for turn in turns])
    jacobians = [jacobian(arm, q[k], X[k, :3, 3]) for k in range(len(table["jacobian"]))]
    limits = [joint.find("limit") for joint in ElementTree.parse(urdf).iter("joint") if joint.get("type") != "fixed"]
    bounds = (("lower", "-inf"), ("upper", "inf"), ("velocity", ""), ("effort", ""))
    limits_in_file = [[float(attribute(limit, name) or default) for name, default in bounds] for limit in limits]
    values = [[joint.low, joint.high, joint.velocity, joint.torque] for joint in arm.joints]
    pairs = {
        "flange position [m]": (X[:, :3, 3], table["flange"][:, :3]),
        "flange rotation": (X[:, :3, :3], rotations),
        "gravity torques [N m]": (gravity_torques(arm, q), table["gravity"]),
        "torques in motion [N m]": (
            inverse_dynamics(arm, first, table["velocities"], table["accelerations"]),
            table["torques"],
        ),
        "Jacobian": (jacobians, table["jacobian"]),
        "masses [kg]": ([link.mass for link in arm.links], table["masses"]),
        "centres of mass [m]": ([link.p_LC for link in arm.links], table["centres"]),
        "inertias [kg m2]": ([link.inertia for link in arm.links], table["inertias"]),
    }
    found = {name: float(np.abs(np.subtract(a, b)).max()) for name, (a, b) in pairs.items()}
    return {**found, "limits of the joints": 0.0 if values == limits_in_file else float("inf")}


def main() -> int:
    """Write a table, or compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("urdf", type=Path)
    parser.add_argument("flange", help="name of the link that the tool is fixed to")
    parser.add_argument("--postures", type=int, default=1000)
    parser.add_argument("--out", type=Path, help="the table to write; without it our Gen3 is compared")
    options = parser.parse_args()
    if options.out is not None:
        np.savez_compressed(options.out, **table_of(options.urdf, options.flange, options.postures))
        return 0
    found = differences(options.urdf, options.flange)
    for name, difference in found.items():
        print(f"{name:24} {difference:.1e}")
    return int(max(found.values()) > 1e-9)


if __name__ == "__main__":
    sys.exit(main())
