"""SAPIEN replaces its kinematics when Pinocchio can be imported; its physics, which is what we use, stays the same."""

import subprocess
import sys
from pathlib import Path

import sapien

PHYSICS = """
import hashlib, sys
if sys.argv[1] == "without":
    sys.modules["pinocchio"] = None  # an import of it fails
import numpy as np, trimesh
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Cut, Done
from cutgrammar.settings import Settings
from cutgrammar_sim.worlds.board import Board
import sapien
from sapien import physx

shape = trimesh.creation.icosphere(subdivisions=2, radius=0.04)
board = Board(Settings().world)
board.reset([Fragment(Mesh(shape.vertices, shape.faces), Pose(np.eye(3), [0.01, 0.0, 0.05]))])
ball = board.truth()[0]
made = board.apply(Cut(Plane.through(ball.p_WC, [1.0, 0.2, 0.1]), ball.p_WC[None]))
assert isinstance(made, Done), made
numbers = [fragment.X_WF.to_vector() for fragment in board.truth()]

scene = sapien.Scene([physx.PhysxCpuSystem()])
builder = scene.create_articulation_builder()
link = builder.create_link_builder(None)
for _ in range(6):
    link = builder.create_link_builder(link)
    in_parent, in_child = sapien.Pose([0.1, 0, 0.02]), sapien.Pose([0, 0, 0.1])
    link.set_joint_properties("revolute_unwrapped", [[-3.0, 3.0]], in_parent, in_child)
    link.add_capsule_collision(sapien.Pose([0.05, 0, 0]), 0.02, 0.05)
arm = builder.build(fix_root_link=True)
for joint in arm.get_active_joints():
    joint.set_drive_properties(100.0, 5.0)
    joint.set_drive_target(0.7)
for _ in range(200):
    scene.step()
    numbers.append(np.concatenate([arm.get_qpos(), arm.get_qvel()]))
print("pinocchio" in sys.modules and sys.modules["pinocchio"] is not None)
print(hashlib.sha256(np.concatenate(numbers).astype(np.float64).tobytes()).hexdigest())
"""


def test_only_the_kinematics_wrapper_of_sapien_imports_pinocchio():
    folder = Path(sapien.__file__).parent
    importing = {
        path.relative_to(folder).as_posix() for path in folder.rglob("*.py") if "import pinocchio\n" in path.read_text()
    }
    assert importing == {"wrapper/pinocchio_model.py"}


def test_physics_is_the_same_bit_for_bit_with_and_without_pinocchio():
    printed = {}
    for mode in ("with", "without"):
        run = subprocess.run([sys.executable, "-c", PHYSICS, mode], capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stderr
        printed[mode] = run.stdout.split()
    assert printed["with"][0] == "True"
    assert printed["without"][0] == "False"
    assert printed["with"][1] == printed["without"][1]
