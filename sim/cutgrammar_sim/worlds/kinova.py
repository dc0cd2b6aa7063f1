"""The world of the arm: the knife of a robot makes the cut that a planner asks for, or refuses it with a reason.

A cut is planned completely before anything moves, so a refusal changes nothing. Then the arm carries out the plan in a
SAPIEN scene ("depth and lock"): all fragments are held; when the edge has reached the board, those meant are sliced by
the plane that the blade actually passed; their halves are parted by its thickness; the arm goes home; all fragments are
released and settle. A joint that exceeds its limits although the plan kept them makes the cut a failure.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.slicing import Missed, Sliced, slice_mesh
from cutgrammar.interfaces import Cut, Done, Failed, Refused, Stream
from cutgrammar.motion import Execution, Motion, Phase
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.execution.articulation import Articulation, build
from cutgrammar_sim.arm.execution.execute import Realised, carry_out, motor_loads
from cutgrammar_sim.arm.execution.log import joined
from cutgrammar_sim.arm.execution.motion import motion_of, phases_of
from cutgrammar_sim.arm.execution.settling import Settling
from cutgrammar_sim.arm.planning.cut_plan import CutPlan, plan_cut
from cutgrammar_sim.arm.planning.forecast import exceeded, overload, resistance_to
from cutgrammar_sim.arm.planning.rig import Rig, rig_of
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.tool import knife
from cutgrammar_sim.arm.robot.urdf import read_urdf
from cutgrammar_sim.physics.section import section
from cutgrammar_sim.physics.toughness import fracture_toughness, max_resistance
from cutgrammar_sim.worlds.division import divide
from cutgrammar_sim.worlds.lying_fragments import LyingFragments, parted

THROUGH = 0.3e-3
"""Height above the board at which the edge may end and still count as through: the board gives way as much [m]."""


class KinovaWorld:
    """A `World` whose cuts are made by an arm; `observe` is exact.

    Attributes:
        arm, tool: as the settings describe them.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._rig = _rig(settings)
        self.arm, self.tool = self._rig.arm, self._rig.tool
        self._foods: tuple[str | None, ...] = ()
        self._new_scene()

    def reset(self, start: Configuration, foods: Sequence[str] = ()) -> None:
        """Lay out the initial configuration in a fresh scene and let it settle; what reaches under the board is raised.

        Args:
            start: meshes, in W.
            foods: name of each object's food; without them `kinova.toughness` is the toughness of all.

        Raises:
            TypeError: a fragment is known as a point cloud only.
            ValueError: foods, but not as many as there are objects.
            HullError: a fragment is too thin for the simulator.
        """
        if foods and len(foods) != len(start):
            raise ValueError(f"{len(foods)} foods for {len(start)} objects; one for each is needed, or none")
        self._new_scene()
        self._lying.lay_out(start)
        self._foods = tuple(foods) or (None,) * len(start)
        self._lying.settle()

    def observe(self) -> Configuration:
        """The current fragments as they lie."""
        return self._lying.now

    def truth(self) -> Configuration:
        """The current fragments as they lie."""
        return self._lying.now

    def apply(self, cut: Cut) -> Done | Refused | Failed:
        """Plan the cut and let the arm make it."""
        now = self._lying.now
        divided = divide(now, cut, self._settings.world.min_share)
        if isinstance(divided, Refused):
            return divided
        shapes = self._lying.shapes_of([mesh for sliced in divided.values() for mesh in sliced.products])
        if isinstance(shapes, str):
            return Refused(shapes)
        meant = tuple(divided)
        sections = [section(now[index], cut.plane_W) for index in meant]
        force = max_resistance(sections, [self._toughness(index) for index in meant])
        plan = plan_cut(now, meant, cut.plane_W, self._rig, self._posture, force)
        if isinstance(plan, Refused):
            return plan
        return self._execute(plan, cut)

    def _new_scene(self) -> None:
        self._lying = LyingFragments(self._settings.world, tgs=False)
        self._body: Articulation = build(self._lying.bodies.scene, self.arm, self.tool)
        self._posture: Floats = np.asarray(self.arm.home)

    def _toughness(self, index: int) -> float:
        """Fracture toughness of a fragment [J/m2]."""
        return fracture_toughness(self._foods[index], self._settings.kinova.toughness)

    def _execute(self, plan: CutPlan, cut: Cut) -> Done | Refused | Failed:
        """Carry out a plan and let all settle."""
        lying, before, density = self._lying, self._lying.now, self._settings.world.density
        met = resistance_to(plan, before, {i: self._toughness(i) for i in plan.meant}, self.tool)
        reason = overload(plan, before, met, self.arm, self.tool, density)
        if reason is not None:
            return Refused(reason)
        handled = sorted({*plan.meant, *plan.set_aside})
        lying.bodies.hold(lying.entities)
        lying.take_out(handled)
        realised = carry_out(plan, before, met, self._body, lying.bodies.step)
        self._posture = plan.legs[-1].trajectory.positions[-1]
        placed = realised.placed(plan, before)
        loads = motor_loads(plan, before, realised.log, self.arm, self.tool, density)
        divided = self._divided(plan, realised, placed, loads[0])
        if isinstance(divided, Failed):
            self._put({index: [placed[index]] for index in handled})
            return divided
        gap_W = self._settings.world.blade_thickness_mm * 1e-3 * plan.plane_W.normal
        self._put({i: parted(placed[i], divided[i], gap_W) if i in divided else [placed[i]] for i in handled})
        phases = phases_of(plan, realised, before, lying.now)
        parts = lying.now
        lying.bodies.release(lying.entities)
        settling = Settling(lying.entities, self._body)
        if not lying.settle(settling.sample):
            return Failed("a fragment left the board")
        rest = settling.log(float(realised.log.times[-1]), self._posture, len(plan.legs))
        resting = motor_loads(plan, before, rest, self.arm, self.tool, density)
        both = np.concatenate([loads[0], resting[0]]), np.concatenate([loads[1], resting[1]])
        phases.append(Phase("settle", len(realised.log.times), parts, settling.poses))
        motion = motion_of(self.arm, self.tool, plan, joined([realised.log, rest]), both, phases)
        execution = _execution(plan, cut, before, placed, realised, motion)
        return Done(sum(len(sliced.products) for sliced in divided.values()), execution, motion)

    def _divided(
        self, plan: CutPlan, realised: Realised, placed: Configuration, torques: Floats
    ) -> dict[int, Sliced] | Failed:
        """Products of the fragments meant, in their frames F, or what went wrong."""
        log = realised.log
        for quantity, values in (("torque", torques), ("velocity", log.qd)):
            for number, leg in enumerate(plan.legs):
                reason = exceeded(self.arm, values[log.legs == number], quantity, leg.phase)
                if reason is not None:
                    return Failed(reason)
        if realised.lowest > THROUGH:
            return Failed(f"the blade stopped {realised.lowest * 1e3:.2f} mm above the board")
        plane_W = realised.plane_W(plan.plane_W)
        divided: dict[int, Sliced] = {}
        for index in plan.meant:
            fragment = placed[index]
            plane_F = plane_W.transformed(fragment.X_WF.inverse())
            sliced = slice_mesh(fragment.mesh, plane_F, self._settings.world.min_share)
            if isinstance(sliced, Missed):
                return Failed(sliced.reason)
            divided[index] = sliced
        shapes = self._lying.shapes_of([mesh for sliced in divided.values() for mesh in sliced.products])
        return Failed(shapes) if isinstance(shapes, str) else divided

    def _put(self, new: dict[int, list[Fragment]]) -> None:
        """Put the fragments that were handled, or their products, back into the scene, held."""
        shapes_of = self._lying.bodies.shapes
        with_shapes = {index: [(part, shapes_of(part.mesh)) for part in parts] for index, parts in new.items()}
        self._foods = tuple(self._foods[origin] for origin in self._lying.replace(with_shapes, held=True))


def make_world(settings: Settings, stream: Stream) -> KinovaWorld:
    """SAPIEN with a Kinova Gen3 that makes the cuts; then the fragments settle. Nothing is drawn from `stream`."""
    del stream
    return KinovaWorld(settings)


def _execution(
    plan: CutPlan, cut: Cut, before: Configuration, placed: Configuration, realised: Realised, motion: Motion
) -> Execution:
    """Figures of a cut; errors are measured in the frames of the fragments, wherever these were carried."""
    angles, distances = [], []
    for index in plan.meant:
        meant_W = cut.plane_W.transformed(placed[index].X_WF @ before[index].X_WF.inverse())
        angle, distance = realised.plane_error(meant_W, section(placed[index], meant_W).reshape(-1, 3))
        angles.append(angle)
        distances.append(distance)
    carry = plan.carry
    moved = 0.0 if carry is None else float(np.linalg.norm(placed[carry.fragment].p_WC - before[carry.fragment].p_WC))
    torque_share = float((np.abs(motion.torques) / motion.torque_limits).max())
    velocity_share = float((np.abs(motion.velocities) / motion.velocity_limits).max())
    low, high = motion.position_limits.T
    within = bool(((motion.positions >= low) & (motion.positions <= high)).all())
    return Execution(
        why_moved=None if carry is None else carry.why,
        turned_deg=0.0 if carry is None else carry.turned_deg,
        carried=moved,
        plane_error_deg=float(np.degrees(max(angles))),
        plane_error_mm=max(distances) * 1e3,
        seconds=float(motion.times[-1]),
        blade_force=float(motion.blade_force.max()),
        torque_share=torque_share,
        velocity_share=velocity_share,
        limits_kept=within and torque_share <= 1.0 and velocity_share <= 1.0,
        set_aside=len(plan.set_aside),
    )


@lru_cache(maxsize=4)
def _rig(settings: Settings) -> Rig:
    """The arm with its tool that the settings describe."""
    other = settings.kinova.urdf
    arm = read_urdf(other, settings.kinova.flange) if other else gen3()
    return rig_of(arm, knife(settings), settings)
