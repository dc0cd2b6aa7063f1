import hashlib

import numpy as np
import pytest
import trimesh

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.interfaces import Cut, Done, Failed, Refused
from cutgrammar.plugins import FOODS, load, reference_of
from cutgrammar.settings import CameraSettings, Settings, WorldSettings
from cutgrammar_sim.arm.execution.articulation import build
from cutgrammar_sim.arm.execution.execute import carry_out, motor_loads
from cutgrammar_sim.arm.planning.cut_plan import plan_cut
from cutgrammar_sim.arm.planning.forecast import overload, resistance_to
from cutgrammar_sim.arm.planning.loads import pushed_torques
from cutgrammar_sim.arm.planning.rig import rig_of
from cutgrammar_sim.arm.robot.dynamics import GRAVITY, inverse_dynamics
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.kinematics import flange_poses
from cutgrammar_sim.arm.robot.tool import knife
from cutgrammar_sim.cameras.look import look
from cutgrammar_sim.physics.bodies import Bodies
from cutgrammar_sim.physics.toughness import FRACTURE, FRICTION, SIDE_PRESSURE
from cutgrammar_sim.worlds import kinova as module
from cutgrammar_sim.worlds.kinova import KinovaWorld
from simple_shapes import box_fragment

X, Y, Z = np.eye(3)
ARM, TOOL = gen3(), knife(Settings())


def bar(x=0.0, y=0.0, size=(0.08, 0.03, 0.02)):
    return box_fragment(size, [x, y, size[2] / 2])


def food(name, seed=0):
    mesh = load(reference_of(FOODS, name))(np.random.default_rng(seed))
    return Fragment(mesh, Pose(np.eye(3), [0.0, 0.0, -mesh.vertices[:, 2].min()]))


def cut_of(fragment, normal, shift=0.0):
    normal = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    return Cut(Plane.through(fragment.p_WC + shift * normal, normal), fragment.p_WC[None])


def world_of(*start, foods=()):
    world = KinovaWorld(Settings())
    world.reset(start, foods)
    return world


def fingerprint(configuration):
    numbers = [a.tobytes() for f in configuration for a in (f.X_WF.to_vector(), f.mesh.vertices, f.mesh.faces)]
    return hashlib.sha256(b"".join(numbers)).hexdigest()


def bar_cut_by(normal):
    """A bar is cut: the configuration before, the result, the configuration after."""
    world = world_of(bar(), foods=["potato"])
    before = world.truth()
    result = world.apply(cut_of(before[0], normal))
    assert isinstance(result, Done), result
    return before, result, world.truth()


@pytest.fixture(scope="module")
def pressed():
    """A bar cut where it lies (see `bar_cut_by`)."""
    return bar_cut_by([1, 0.2, 0.3])


@pytest.fixture(scope="module")
def turned():
    """A level cut, for which the bar must be turned."""
    return bar_cut_by([0.0, 0.05, 1.0])


@pytest.fixture(scope="module")
def followed():
    """A plan carried out directly, and the wrench on the wrist that the scene measures at every step."""
    now = (bar(),)
    bodies = Bodies(Settings().world, tgs=False)
    body = build(bodies.scene, ARM, TOOL)
    rig = rig_of(ARM, TOOL, Settings())
    plan = plan_cut(now, (0,), Plane(X, 0.0), rig, np.asarray(ARM.home), 30.0)
    assert not isinstance(plan, Refused)
    met = resistance_to(plan, now, {0: 900.0}, TOOL)
    seen = []

    def step():
        bodies.scene.step()
        wrenches = bodies.scene.get_all_articulations()[0].get_link_incoming_joint_forces()
        seen.append(-np.asarray(wrenches[-1], dtype=np.float64))  # of the tool on the flange, axes of T

    return now, plan, met, carry_out(plan, now, met, body, step), np.array(seen)


def test_the_products_lie_on_both_sides_of_the_plane_meant(pressed):
    before, result, after = pressed
    assert result.products == len(after) == 2
    plane_F = cut_of(before[0], [1, 0.2, 0.3]).plane_W.transformed(before[0].X_WF.inverse())
    for mesh, side in zip((f.mesh for f in after), (1, -1), strict=True):
        assert (side * plane_F.distances(mesh.vertices)).min() > -2e-5


def test_the_reported_error_of_the_plane_is_the_true_one(pressed):
    before, result, after = pressed
    plane_F = cut_of(before[0], [1, 0.2, 0.3]).plane_W.transformed(before[0].X_WF.inverse())
    known = {tuple(vertex) for vertex in before[0].mesh.vertices.round(9)}
    new = np.array([v for v in after[0].mesh.vertices if tuple(v.round(9)) not in known])
    off = 1e3 * abs(plane_F.distances(new)).max()
    assert off <= result.execution.plane_error_mm + 1e-4
    assert result.execution.plane_error_mm < 0.05
    assert result.execution.plane_error_deg < 0.02


def test_a_motion_is_complete_and_consistent(pressed, turned):
    for _, result, after in (pressed, turned):
        motion = result.motion
        t, j = len(motion.times), len(motion.joints)
        assert (np.diff(motion.times) > 0).all()
        for array in (motion.positions, motion.velocities, motion.torques):
            assert array.shape == (t, j)
        assert motion.poses.shape == (t, len(motion.links), 7)
        assert motion.wrench_W.shape == (t, 6)
        firsts = [phase.first for phase in motion.phases]
        assert firsts[0] == 0
        assert (np.diff(firsts) > 0).all()
        for phase, end in zip(motion.phases, [*firsts[1:], t], strict=True):
            assert phase.poses is None or phase.poses.shape == (end - phase.first, len(phase.fragments), 7)
        settled = motion.phases[-1]
        assert settled.name == "settle"
        for now, pose in zip(after, settled.poses[-1], strict=True):
            assert now.X_WF.to_vector() == pytest.approx(pose, abs=1e-3)
        assert result.execution.limits_kept
        assert result.execution.torque_share < 1.0
        assert result.execution.seconds == motion.times[-1]


def test_a_press_from_above_needs_no_carrying(pressed):
    _, result, _ = pressed
    names = [phase.name for phase in result.motion.phases]
    assert names == ["transit", "approach", "press", "retreat", "transit", "settle"]
    assert result.execution.why_moved is None
    assert [len(phase.fragments) for phase in result.motion.phases] == [1, 1, 1, 2, 2, 2]


def test_the_edge_reaches_the_board_and_does_not_enter_it(pressed, turned):
    for _, result, _ in (pressed, turned):
        motion = result.motion
        index, link = next((i, link) for i, link in enumerate(motion.links) if link.name == "blade")
        lowest = [Pose.from_vector(pose).apply(link.mesh.vertices)[:, 2].min() for pose in motion.poses[:, index]]
        assert min(lowest) == pytest.approx(0.0, abs=1e-4)
        press = next(phase.first for phase in motion.phases if phase.name == "press")
        assert press <= np.argmin(lowest)


def test_the_blade_meets_the_foods_toughness(pressed):
    _, result, _ = pressed
    width, depth = 0.03 * np.sqrt(1 + 0.2**2), 0.02 * np.sqrt(1 + 0.3**2)
    min_force = FRACTURE["potato"] * width
    max_force = 1.3 * (min_force + 2 * FRICTION * SIDE_PRESSURE * width * depth)
    assert min_force <= result.motion.blade_force.max() <= max_force
    force = result.motion.wrench_W[np.argmax(result.motion.blade_force), :3]
    assert np.linalg.norm(force + 9.81 * TOOL.load.mass * Z) == pytest.approx(result.execution.blade_force, abs=1.5)


def test_a_fragment_is_carried_by_the_gripper_and_cut_as_meant(turned):
    before, result, after = turned
    motion, execution = result.motion, result.execution
    assert "too flat" in execution.why_moved
    assert execution.turned_deg > 45
    assert execution.plane_error_deg < 0.02
    carried = [phase for phase in motion.phases if phase.name in ("carry", "place")]
    assert np.concatenate([p.poses for p in carried])[0, 0, :3] == pytest.approx(before[0].X_WF.position, abs=1e-3)
    index = next(
        i for i, link in enumerate(motion.links) if link.name == "handle"
    )  # fixed to the flange, as the gripper
    grips = [
        (
            Pose.from_vector(motion.poses[phase.first + k, index]).inverse() @ Pose.from_vector(phase.poses[k, 0])
        ).to_vector()
        for phase in carried
        for k in range(0, len(phase.poses), 25)
    ]
    assert np.ptp(np.array(grips), axis=0).max() < 1e-6
    press = next(phase for phase in motion.phases if phase.name == "press")
    assert press.fragments[0].X_WF.to_vector() == pytest.approx(carried[-1].poses[-1, 0], abs=1e-9)
    assert execution.carried == pytest.approx(np.linalg.norm(press.fragments[0].p_WC - before[0].p_WC))
    assert sum(f.mesh.volume for f in after) == pytest.approx(before[0].mesh.volume, rel=1e-9)


def test_what_lies_on_a_fragment_is_set_aside_and_stays_whole():
    low, top = box_fragment((0.06, 0.06, 0.02), [0, 0, 0.01]), box_fragment((0.05, 0.05, 0.02), [0, 0, 0.03])
    world = world_of(low, top)
    before = world.truth()
    result = world.apply(cut_of(before[0], X))
    assert isinstance(result, Done), result
    execution, motion = result.execution, result.motion
    assert (execution.set_aside, execution.why_moved, execution.carried) == (1, None, 0.0)
    assert execution.limits_kept
    names = [phase.name for phase in motion.phases]
    assert names[:5] == ["transit", "pick", "carry", "place", "retreat"]
    press = motion.phases[names.index("press")]
    lying = [fragment.mesh.volume for fragment in press.fragments]
    assert lying == pytest.approx([f.mesh.volume for f in before])
    moved = next(f for f in press.fragments if f.mesh is before[1].mesh)
    assert np.linalg.norm(moved.p_WC[:2] - before[1].p_WC[:2]) > 0.05
    assert moved.p_WC[2] == pytest.approx(0.01, abs=2e-3)
    after = world.truth()
    assert len(after) == 3
    (whole,) = [f for f in after if f.mesh is before[1].mesh]
    assert np.linalg.norm(whole.p_WC - moved.p_WC) < 5e-3
    assert sum(f.mesh.volume for f in after) == pytest.approx(sum(f.mesh.volume for f in before), rel=1e-9)


def test_the_logged_torques_are_those_of_the_motion(followed):
    now, plan, _, realised, _ = followed
    log = realised.log
    logged, _ = motor_loads(plan, now, log, ARM, TOOL, 1000.0)
    rates = np.diff(log.qd, axis=0, prepend=0.0) * 240.0
    taken = inverse_dynamics(ARM, log.q, log.qd, rates, (TOOL.load,)) + pushed_torques(ARM, log.q, log.pushes)
    assert np.median(abs(logged - taken), axis=0) == pytest.approx(0.0, abs=0.01)
    assert abs(logged - taken).max() < 0.5
    assert abs(logged).max() > 10.0


def test_the_wrench_on_the_wrist_is_what_the_scene_measures(followed):
    now, plan, _, realised, wrenches = followed
    _, logged = motor_loads(plan, now, realised.log, ARM, TOOL, 1000.0)
    R = flange_poses(ARM, realised.log.q[1:])[:, :3, :3]
    force, torque = (np.einsum("tab,tb->ta", R, part) for part in (wrenches[:, :3], wrenches[:, 3:]))
    weight = np.array([0.0, 0.0, -GRAVITY * TOOL.load.mass])  # the scene has no gravity for the tool
    measured = np.concatenate([force + weight, torque + np.cross(R @ TOOL.load.p_TC, weight)], axis=1)
    off = abs(logged[1:] - measured).max(axis=1)
    assert np.median(off) < 0.05
    assert np.percentile(off, 99) < 1.0
    assert np.linalg.norm(measured[:, :3], axis=1).max() > 20.0


def test_the_forecast_loads_are_those_of_the_motion(followed):
    now, plan, met, realised, _ = followed
    assert overload(plan, now, met, ARM, TOOL, 1000.0) is None
    assert realised.lowest == pytest.approx(0.0, abs=1e-4)
    assert realised.log.q[-1] == pytest.approx(ARM.home, abs=1e-3)
    strong = resistance_to(plan, now, {0: 5000.0}, TOOL)
    assert "exceeds its torque in the press" in overload(plan, now, strong, ARM, TOOL, 1000.0)


def test_a_cut_that_the_motors_are_too_weak_for_is_refused(monkeypatch):
    world = world_of(bar())
    before = fingerprint(world.truth())
    monkeypatch.setattr(module, "fracture_toughness", lambda food, otherwise: 2e4)
    result = world.apply(cut_of(world.truth()[0], X))
    assert isinstance(result, Refused)
    assert "motors are too weak" in result.reason
    monkeypatch.setattr(module, "max_resistance", lambda *seen: 0.0)
    result = world.apply(cut_of(world.truth()[0], X))
    assert isinstance(result, Refused)
    assert "exceeds its torque in the press" in result.reason
    assert fingerprint(world.truth()) == before


def test_an_overload_that_was_not_forecast_ends_the_cut(monkeypatch):
    world = world_of(bar())
    before = world.truth()
    monkeypatch.setattr(module, "fracture_toughness", lambda food, otherwise: 2e4)
    monkeypatch.setattr(module, "max_resistance", lambda *seen: 0.0)
    monkeypatch.setattr(module, "overload", lambda *seen: None)
    result = world.apply(cut_of(before[0], X))
    assert isinstance(result, Failed)
    assert "exceeds its torque in the press" in result.reason
    assert [f.mesh for f in world.truth()] == [f.mesh for f in before]
    assert world.truth()[0].p_WC == pytest.approx(before[0].p_WC, abs=1e-3)


def test_foods_are_as_many_as_objects():
    with pytest.raises(ValueError, match="1 foods for 2 objects"):
        world_of(bar(), bar(0, 0.1), foods=["carrot"])


def test_fragments_keep_the_food_of_their_parent(monkeypatch):
    world = world_of(bar(0, -0.15), bar(0, 0.15), foods=["carrot", "potato"])
    asked = []
    monkeypatch.setattr(module, "fracture_toughness", lambda name, otherwise: asked.append(name) or 200.0)
    for index in (0, 2):
        assert isinstance(world.apply(cut_of(world.truth()[index], X)), Done)
    assert asked == ["carrot", "carrot", "potato", "potato"]


@pytest.mark.slow
def test_a_banana_is_cut_into_three_at_once():
    world = world_of(food("banana"), foods=["banana"])
    lying = world.truth()[0]
    low, high = np.quantile(lying.mesh.vertices[:, 1], [0.05, 0.95])
    crossing = [0.0, 0.5 * (low + high), 0.0]  # the plane meets both arms below the bend
    result = world.apply(Cut(Plane.through(lying.X_WF.apply(crossing), lying.X_WF.rotate(Y)), lying.p_WC[None]))
    assert isinstance(result, Done), result
    assert result.products == 3


@pytest.mark.slow
def test_a_trial_is_the_same_after_ten_others():
    def play(seed, cuts=2):
        rng = np.random.default_rng(seed)
        world = world_of(food("carrot", seed), bar(0.0, 0.12), foods=["carrot", "block"])
        results = [world.apply(cut_of(world.truth()[0], rng.normal(size=3))) for _ in range(cuts)]
        return repr(results) + fingerprint(world.truth())

    first = play(0)
    for seed in range(1, 11):
        play(seed, cuts=1)
    assert play(0) == first


@pytest.mark.slow
def test_a_trial_is_the_same_with_cameras_in_the_scene():
    def play(looks):
        world = world_of(food("carrot"), foods=["carrot"])
        results = []
        for normal in ([1, 0.1, 0], [0, 1, 0.1]):
            if looks:
                look(world.observe(), CameraSettings(), np.random.default_rng(0))
            results.append(world.apply(cut_of(world.truth()[0], normal)))
        return repr(results) + fingerprint(world.truth())

    assert play(looks=True) == play(looks=False)


def test_a_cut_whose_product_is_too_thin_for_the_simulator_is_refused():
    settings = Settings(world=WorldSettings(min_share=1e-6))
    world = KinovaWorld(settings)
    disc = trimesh.creation.cylinder(0.02, 0.01, sections=40)
    wheel = Mesh(disc.vertices @ np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]]).T, disc.faces)
    world.reset((Fragment(wheel, Pose(np.eye(3), [0, 0, 0.02])),))
    before = fingerprint(world.truth())
    axis = world.truth()[0].X_WF.rotate(X)
    result = world.apply(cut_of(world.truth()[0], axis, shift=0.00499))
    assert isinstance(result, Refused)
    assert "too thin" in result.reason
    assert fingerprint(world.truth()) == before


def test_a_fragment_that_leaves_the_board_ends_the_trial(monkeypatch):
    world = world_of(bar())
    monkeypatch.setattr(Bodies, "settle", lambda self, entities, watch: False)
    result = world.apply(cut_of(world.truth()[0], X))
    assert result == Failed("a fragment left the board")
    assert len(world.truth()) == 2


def test_a_blade_that_does_not_get_through_fails(monkeypatch):
    world = world_of(bar())
    monkeypatch.setattr(module, "THROUGH", -0.01)
    result = world.apply(cut_of(world.truth()[0], X))
    assert isinstance(result, Failed)
    assert "above the board" in result.reason
    assert len(world.truth()) == 1
