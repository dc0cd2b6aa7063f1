from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cutgrammar.errors import InputError
from cutgrammar_sim.arm.robot.description import X_WA
from cutgrammar_sim.arm.robot.dynamics import gravity_torques, inverse_dynamics
from cutgrammar_sim.arm.robot.kinematics import flange_pose, flange_poses, inverse_kinematics, jacobian
from cutgrammar_sim.arm.robot.urdf import read_urdf

DATA = Path(__file__).parents[3] / "data"
UR5E = (DATA / "ur5e.urdf").read_text()


@pytest.fixture(scope="module")
def arm():
    return read_urdf(UR5E, "flange")


@pytest.fixture(scope="module")
def table():
    """Made by benchmarks/arm_reference.py from the same file, by Pinocchio."""
    return dict(np.load(DATA / "ur5e_reference.npz", allow_pickle=False))


def test_another_arm_has_the_kinematics_and_dynamics_of_its_urdf(arm, table):
    q = table["postures"]
    X = flange_poses(arm, q)
    turned = Rotation.from_matrix(X[:, :3, :3]).inv() * Rotation.from_quat(table["flange"][:, 3:], scalar_first=True)
    assert np.abs(X[:, :3, 3] - table["flange"][:, :3]).max() < 1e-9
    assert turned.magnitude().max() < 1e-9
    assert np.abs(gravity_torques(arm, q) - table["gravity"]).max() < 1e-9
    moved = inverse_dynamics(arm, q[:10], table["velocities"], table["accelerations"])
    assert np.abs(moved - table["torques"]).max() < 1e-9
    assert np.abs([jacobian(arm, q[k], X[k, :3, 3]) for k in range(2)] - table["jacobian"]).max() < 1e-9


def test_links_fixed_to_a_link_become_part_of_it(arm):
    assert [link.name for link in arm.links] == [
        "base_link", "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3",
    ]  # fmt: skip
    assert [joint.name for joint in arm.joints][2] == "elbow"
    assert arm.links[0].mass == 4.0
    assert arm.links[-1].mass == pytest.approx(0.365 + 0.2)


def test_primitives_become_capsules_that_cover_them(arm, rng):
    (cylinder,) = arm.links[3].capsules
    turn = rng.uniform(0.0, 2.0 * np.pi, 500)
    rim = np.stack([rng.choice([-0.3922, 0.0], 500), 0.048 * np.cos(turn), 0.007 + 0.048 * np.sin(turn)], axis=1)
    assert away(rim, [cylinder]).max() < 1e-9
    sphere, *box = arm.links[-1].capsules
    assert sphere.radius == 0.04
    corners = np.stack(np.meshgrid([-0.015, 0.015], [-0.04, 0.04], [0.0, 0.02]), axis=-1).reshape(-1, 3)
    turned = Rotation.from_euler("xyz", [0.3, 0.0, 0.2]).apply(corners)
    assert away(turned + np.array([0.0, -0.05, 0.06]), box).max() < 1e-9


def away(points, capsules):
    """How far points are outside of all capsules [m]."""
    found = []
    for capsule in capsules:
        a, b = capsule.ends
        share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        found.append(np.linalg.norm(points - a - share[:, None] * (b - a), axis=1) - capsule.radius)
    return np.min(found, axis=0)


def test_a_link_whose_shape_is_a_mesh_is_covered_from_joint_to_joint():
    mesh = '<mesh filename="package://nowhere/forearm.stl"/>'
    text = UR5E.replace('<cylinder radius="0.048" length="0.3922"/>', mesh)
    (capsule,) = read_urdf(text, "flange").links[3].capsules
    assert capsule.ends == pytest.approx(np.array([[-0.05, 0.0, 0.0], [-0.3422, 0.0, 0.0]]))
    assert capsule.radius == 0.05


def test_its_home_hangs_over_the_board_within_its_limits(arm):
    X_WT = X_WA @ flange_pose(arm, arm.home)
    assert X_WT.rotation[2, 2] == pytest.approx(-1.0)
    assert X_WT.position[2] > 0.4
    assert np.abs(X_WT.position[:2]).max() < 0.2
    for angle, joint in zip(arm.home, arm.joints, strict=True):
        assert joint.low + 0.1 < angle < joint.high - 0.1
    assert np.array_equal(arm.home, read_urdf(UR5E, "flange").home)


def test_another_arm_reaches_poses_over_the_board(arm, rng):
    found = 0
    for _ in range(50):
        yaw, tilt = rng.uniform(-np.pi, np.pi), rng.uniform(-0.5, 0.5)
        turn = Rotation.from_euler("zyx", [yaw, tilt, np.pi]).as_matrix()
        place = X_WA.inverse().apply(rng.uniform([-0.1, -0.15, 0.2], [0.1, 0.15, 0.4]))
        X_AT = type(arm.X_LT)(turn, place)
        q = inverse_kinematics(arm, X_AT, arm.home)
        if q is not None:
            found += 1
            assert np.abs(flange_pose(arm, q).position - place).max() < 1e-6
    assert found >= 45


CONTINUOUS = '<joint name="elbow" type="continuous">'
ELBOW = '<joint name="elbow" type="revolute">'


def test_a_continuous_joint_needs_no_range():
    arm = read_urdf(UR5E.replace(ELBOW, CONTINUOUS), "flange")
    assert (arm.joints[2].low, arm.joints[2].high) == (-np.inf, np.inf)


LIMITS = '<limit lower="-3.141592653589793" upper="3.141592653589793" velocity="3.141592653589793" effort="150"/>'
BRANCH = """<link name="finger"/><joint name="finger_joint" type="revolute"><parent link="wrist_1"/>
<child link="finger"/><limit lower="0" upper="1" velocity="1" effort="1"/></joint></robot>"""
BOMB = '<!DOCTYPE r [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]><robot name="&b;"/>'


XACRO = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="arm"><xacro:include filename="arm.xacro"/></robot>'
LOW = '<origin xyz="0 0 0.02" rpy="1.5707963267948966 0 0"/>'


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (UR5E, "a knife", "not XML"),
        (UR5E, "<sdf/>", "<robot> is expected"),
        (UR5E, BOMB, "document type"),
        ('<link name="flange"/>', "", "no link 'flange'"),
        (UR5E, XACRO, "a xacro file"),
        (ELBOW, '<joint name="elbow" type="prismatic">', "'elbow' is 'prismatic'"),
        (LIMITS, "", "'elbow' has no <limit>"),
        (LIMITS, '<limit velocity="3" effort="150"/>', "'elbow' has lower None"),
        (LIMITS, '<limit lower="1" upper="-1" velocity="3" effort="150"/>', "ranges from 1 to -1"),
        (LIMITS, '<limit lower="-1" upper="1" velocity="3" effort="0"/>', "both must be above zero"),
        ("</robot>", BRANCH, "'finger_joint' branches off the arm at 'wrist_1'"),
        ('<mass value="2.846"/>', '<mass value="0"/>', "'forearm' moves and has no <inertial>"),
        ('<mass value="2.846"/>', '<mass value="nan"/>', "value 'nan'"),
        ('<origin xyz="-0.425 0 0"', '<origin xyz="-0.425 0"', "three numbers are expected"),
        ('<parent link="forearm"/>', '<parent link="flange"/>', "round in a circle"),
        ('<parent link="forearm"/>', '<parent link="nobody"/>', "'nobody', which is no link"),
        (ELBOW, '<joint name="elbow" type="fixed">', "5 joints turn"),
        ('<origin xyz="0 0 0.0996"', '<origin xyz="0 0 5"', "does not bring 'flange' over it"),
        ('<origin xyz="0 0 0.1625" rpy="1.5707963267948966 0 0"/>', LOW, "is too low"),
    ],
)
def test_a_description_that_is_no_arm_is_refused_in_one_line(old, new, message):
    assert old in UR5E
    with pytest.raises(InputError) as refused:
        read_urdf(UR5E.replace(old, new), "flange")
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def on_wrist(name, rpy):
    """A link of this name, fixed to the last link of the arm with this orientation, which ends the URDF."""
    return f"""<link name="{name}"/><joint name="{name}_mount" type="fixed"><parent link="wrist_3"/>
<child link="{name}"/><origin xyz="0 0 0.0823" rpy="{rpy}"/></joint></robot>"""


@pytest.mark.parametrize("rpy", ["0 1.5708 0", "1.5708 0 0", "0 -1 0"])
def test_a_flange_whose_z_points_sideways_is_refused_with_the_links_that_fit(rpy):
    text = UR5E.replace("</robot>", on_wrist("sideways", rpy))
    with pytest.raises(InputError, match="mounted sideways: z of 'sideways' is (90|57) degrees off") as refused:
        read_urdf(text, "sideways")
    named = str(refused.value).rsplit("it can be fixed to ", 1)[1].replace("'", "").split(" or ")
    assert "flange" in named
    assert all(read_urdf(text, name).joints[-1].name == "wrist_3_turn" for name in named)


def test_a_flange_whose_z_points_into_the_arm_is_refused_with_the_links_that_fit():
    text = UR5E.replace("</robot>", on_wrist("backwards", "3.14159 0 0"))
    with pytest.raises(InputError, match="point into the arm: z of 'backwards' .* 'flange'"):
        read_urdf(text, "backwards")


def test_a_flange_may_be_tilted_a_little():
    assert read_urdf(UR5E.replace("</robot>", on_wrist("tilted", "0.5 0 0")), "tilted").name == "UR5e"


def test_where_no_other_link_fits_the_user_is_told_to_add_one():
    fixed = UR5E.replace('<origin xyz="0 0 0.0996"', '<origin xyz="0 0 5"')
    with pytest.raises(InputError, match="it can be fixed to|add one whose z points out"):
        read_urdf(fixed, "flange")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<link name="forearm"', '<link name="forearm"/><link name="forearm"', "2 links called 'forearm'"),
        (ELBOW, '<joint name="elbow"/>' + ELBOW, "2 joints called 'elbow'"),
    ],
)
def test_a_name_that_stands_twice_is_refused_before_pinocchio_prints_it(old, new, message, capfd):
    with pytest.raises(InputError, match=message):
        read_urdf(UR5E.replace(old, new, 1), "flange")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("name", ["&#x9b;2J", "\u202eno", "&#10;\x85"])
def test_names_that_command_a_terminal_are_refused_before_pinocchio_prints_them(name):
    with pytest.raises(InputError, match="control characters"):
        read_urdf(f'<robot name="arm"><link name="{name}"/></robot>', "flange")
