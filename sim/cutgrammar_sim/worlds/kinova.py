"""The world of the arm: what a planner wants cut is pressed by the knife of a robot, or refused with a reason.

A cut is planned to its end before anything moves, so a refusal changes nothing. Then the arm does as planned in a
SAPIEN scene ("depth and lock"): all fragments are held; when the edge has come down to the board, those meant are
sliced by the plane that the blade truly passed; their halves part by its thickness; the arm goes home; all is let go
and settles. What the plan does not foresee and the log shows, a joint beyond its limits, is a failure.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.slicing import Missed, Sliced, slice_mesh
from cutgrammar.interfaces import Cut, Done, Failed, Refused, Stream
from cutgrammar.motion import Execution, Motion, Phase
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.execution.articulation import Articulation, build
from cutgrammar_sim.arm.execution.execute import Realised, borne, carry_out
from cutgrammar_sim.arm.execution.log import joined
from cutgrammar_sim.arm.execution.motion import motion_of, phases_of
from cutgrammar_sim.arm.execution.settling import Settling
from cutgrammar_sim.arm.planning.cut_plan import CutPlan, plan_cut
from cutgrammar_sim.arm.planning.forecast import exceeded, overload, resistance_to
from cutgrammar_sim.arm.robot.gen3 import gen3
from cutgrammar_sim.arm.robot.rig import Rig, rig_of
from cutgrammar_sim.arm.robot.tool import knife
from cutgrammar_sim.arm.robot.urdf import read_urdf
from cutgrammar_sim.physics.bodies import Bodies
from cutgrammar_sim.physics.hulls import HullError
from cutgrammar_sim.physics.toughness import fracture_toughness, most_resistance
from cutgrammar_sim.worlds.board import on_board, parted
from cutgrammar_sim.worlds.division import divide
from cutgrammar_sim.worlds.free_knife import section

THROUGH = 0.3e-3
"""How far above the board the edge may end and still be through: the board gives as much [m]."""


class KinovaWorld:
    """A `World` whose cuts are made by an arm; `observe` is exact.

    Args:
        settings: all of them.
        watch: is called with the scene after every step of the physics.
    """

    def __init__(self, settings: Settings, watch: Callable[[Any], None] | None = None) -> None:
        self._settings = settings
        self._watch = watch
        self._rig = _rig(settings)
        self.arm, self.tool = self._rig.arm, self._rig.tool
        self._now: Configuration = ()
        self._foods: tuple[str | None, ...] = ()
        self._entities: list[Any] = []
        self._posture: Floats = np.asarray(self.arm.home)
        self._start_anew()

    def reset(self, start: Configuration, foods: Sequence[str] = ()) -> None:
        """Lay out the initial configuration in a fresh scene and let it settle; what reaches under the board is raised.

        Args:
            start: meshes, in W.
            foods: what each of them is, by name; where that is not known `kinova.toughness` holds.

        Raises:
            TypeError: a fragment is known as a point cloud only.
            ValueError: foods, but not as many as there are objects.
            HullError: a fragment is too thin for the simulator.
        """
        if foods and len(foods) != len(start):
            raise ValueError(f"{len(foods)} foods for {len(start)} objects; one for each is needed, or none")
        self._start_anew()
        raised = [on_board(fragment) for fragment in start]
        self._entities = [self._bodies.add(fragment, self._bodies.shapes(fragment.mesh)) for fragment in raised]
        self._now, self._foods = tuple(raised), tuple(foods) or (None,) * len(raised)
        self._settle()

    def _toughness(self, index: int) -> float:
        """Fracture toughness of a fragment [J/m2]."""
        return fracture_toughness(self._foods[index], self._settings.kinova.toughness)

    def observe(self) -> Configuration:
        """The current fragments as they lie."""
        return self._now

    def truth(self) -> Configuration:
        """The current fragments as they lie."""
        return self._now

    def apply(self, cut: Cut) -> Done | Refused | Failed:
        """Plan the cut and let the arm make it."""
        divided = divide(self._now, cut, self._settings.world.min_share)
        if isinstance(divided, Refused):
            return divided
        too_thin = self._too_thin(divided)
        if too_thin is not None:
            return Refused(too_thin)
        meant = tuple(divided)
        sections = [section(self._now[index], cut.plane_W) for index in meant]
        force = most_resistance(sections, [self._toughness(index) for index in meant])
        plan = plan_cut(self._now, meant, cut.plane_W, self._rig, self._posture, force)
        if isinstance(plan, Refused):
            return plan
        return self._carry_out(plan, cut)

    def speed(self) -> float:
        """Greatest speed of any fragment now, after it has settled [m/s]."""
        return self._bodies.speed(self._entities)

    def _start_anew(self) -> None:
        self._bodies = Bodies(self._settings.world, tgs=False)
        self._body: Articulation = build(self._bodies.scene, self.arm, self.tool)
        self._posture = np.asarray(self.arm.home)
        self._entities, self._now, self._foods = [], (), ()

    def _watched_step(self) -> None:
        self._bodies.scene.step()
        assert self._watch is not None
        self._watch(self._bodies.scene)

    def _carry_out(self, plan: CutPlan, cut: Cut) -> Done | Refused | Failed:
        before, density = self._now, self._settings.world.density
        met = resistance_to(plan, before, {i: self._toughness(i) for i in plan.meant}, self.tool)
        too_much = overload(plan, before, met, self.arm, self.tool, density)
        if too_much is not None:
            return Refused(too_much)
        handled = sorted({*plan.meant, *([plan.carry.fragment] if plan.carry is not None else [])})
        self._bodies.hold(self._entities)
        for index in handled:
            self._bodies.remove(self._entities[index])
        step = self._bodies.scene.step if self._watch is None else self._watched_step
        realised = carry_out(plan, before, met, self._body, step)
        self._posture = plan.legs[-1].trajectory.positions[-1]
        placed = realised.placed(plan, before)
        loads = borne(plan, before, realised.log, self.arm, self.tool, density)
        divided = self._divided(plan, realised, placed, loads[0])
        if isinstance(divided, Failed):
            self._put({index: [placed[index]] for index in handled})
            return divided
        gap_W = self._settings.world.blade_thickness_mm * 1e-3 * plan.plane_W.normal
        self._put({i: parted(placed[i], divided[i], gap_W) if i in divided else [placed[i]] for i in handled})
        phases = phases_of(plan, realised.log, before, placed, self._now, realised.carried)
        parts = self._now
        self._bodies.release(self._entities)
        settling = Settling(self._entities, self._body)
        if not self._settle(settling):
            return Failed("a fragment left the board")
        rest = settling.log(float(realised.log.times[-1]), self._posture, len(plan.legs))
        resting = borne(plan, before, rest, self.arm, self.tool, density)
        both = np.concatenate([loads[0], resting[0]]), np.concatenate([loads[1], resting[1]])
        phases.append(Phase("settle", len(realised.log.times), parts, settling.poses))
        motion = motion_of(self.arm, self.tool, plan, joined([realised.log, rest]), both, phases)
        execution = _execution(plan, cut, before, placed, realised, motion)
        return Done(sum(len(sliced.products) for sliced in divided.values()), execution, motion)

    def _divided(
        self, plan: CutPlan, realised: Realised, placed: Configuration, torques: Floats
    ) -> dict[int, Sliced] | Failed:
        """What the blade made of the fragments meant, in their frames F, or what went wrong."""
        log = realised.log
        for what, values in (("torque", torques), ("velocity", log.qd)):
            for number, leg in enumerate(plan.legs):
                said = exceeded(self.arm, values[log.legs == number], what, leg.phase)
                if said is not None:
                    return Failed(said)
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
        too_thin = self._too_thin(divided)
        return divided if too_thin is None else Failed(too_thin)

    def _too_thin(self, divided: Mapping[int, Sliced]) -> str | None:
        """Why the simulator cannot hold the products of a cut; None if it can."""
        try:
            for sliced in divided.values():
                for mesh in sliced.products:
                    self._bodies.shapes(mesh)
        except HullError as error:
            return str(error)
        return None

    def _put(self, new: dict[int, list[Fragment]]) -> None:
        """Let fragments that were handled be there again, or what became of each, held."""
        now: list[Fragment] = []
        foods: list[str | None] = []
        entities: list[Any] = []
        for index, (fragment, food, entity) in enumerate(zip(self._now, self._foods, self._entities, strict=True)):
            if index not in new:
                now, foods, entities = [*now, fragment], [*foods, food], [*entities, entity]
                continue
            for product in new[index]:
                body = self._bodies.add(product, self._bodies.shapes(product.mesh))
                self._bodies.hold([body])
                now, foods, entities = [*now, product], [*foods, food], [*entities, body]
        self._now, self._foods, self._entities = tuple(now), tuple(foods), entities

    def _settle(self, settling: Settling | None = None) -> bool:
        """Let all come to rest; whether all stayed on the board."""

        def watch(step: int) -> None:
            if self._watch is not None:
                self._watch(self._bodies.scene)
            if settling is not None:
                settling.look(step)

        on_board = self._bodies.settle(self._entities, watch)
        self._now = tuple(
            Fragment(fragment.shape, self._bodies.pose(entity))
            for fragment, entity in zip(self._now, self._entities, strict=True)
        )
        return on_board


def make_world(settings: Settings, stream: Stream) -> KinovaWorld:
    """A world for one trial; it has no noise, so `stream` is left alone."""
    del stream
    return KinovaWorld(settings)


def _execution(
    plan: CutPlan, cut: Cut, before: Configuration, placed: Configuration, realised: Realised, motion: Motion
) -> Execution:
    """A cut in numbers; errors are those in the frames of the fragments, wherever these were carried."""
    angles, aways = [], []
    for index in plan.meant:
        meant_W = cut.plane_W.transformed(placed[index].X_WF @ before[index].X_WF.inverse())
        angle, away = realised.plane_error(meant_W, section(placed[index], meant_W).reshape(-1, 3))
        angles.append(angle)
        aways.append(away)
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
        plane_error_mm=max(aways) * 1e3,
        seconds=float(motion.times[-1]),
        blade_force=float(motion.blade_force.max()),
        torque_share=torque_share,
        velocity_share=velocity_share,
        limits_kept=within and torque_share <= 1.0 and velocity_share <= 1.0,
    )


@lru_cache(maxsize=4)
def _rig(settings: Settings) -> Rig:
    """The arm with its tool that the settings describe."""
    other = settings.kinova.urdf
    arm = read_urdf(other, settings.kinova.flange) if other else gen3()
    return rig_of(arm, knife(settings), settings)
