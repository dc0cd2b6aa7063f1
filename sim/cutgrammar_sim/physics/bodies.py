"""Fragments as rigid bodies in a SAPIEN scene of their own, on a board whose top is z = 0 of W.

SAPIEN's results repeat bit for bit only in a fresh scene, so one `Bodies` serves one trial. No Vulkan is needed. Each
fragment collides as its convex hull, a bent one as the hulls of its parts, and has the exact mass, centre of mass and
inertia of its mesh.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.canonical import canonical_frame, covariance
from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.settings import WorldSettings
from cutgrammar_sim.physics.engine import COOKING_SCALE, convex_shape, physx, sapien, sapien_pose
from cutgrammar_sim.physics.hulls import HullError, convex_parts, hull_pieces

TIMESTEP = 1.0 / 240.0
BOARD = [3, 3, 0, 0]
"""Collision groups of the board: bit 1 touches everything, bit 2 touches parts that touch nothing but the board."""
MAX_DISTANCE = 5.0
"""A fragment farther than this from the origin of W has left the board [m]."""


class Bodies:
    """A scene with a board and fragments; `tgs` is PhysX's solver of that name."""

    def __init__(self, settings: WorldSettings, tgs: bool = True) -> None:
        self._settings = settings
        physx.set_scene_config(gravity=np.array([0.0, 0.0, -9.81], dtype=np.float32), enable_tgs=tgs)
        self._system = physx.PhysxCpuSystem()
        self._scene = sapien.Scene([self._system])
        self._scene.set_timestep(TIMESTEP)
        self._material = physx.PhysxMaterial(0.6, 0.5, 0.0)
        ground = self._scene.add_ground(0.0, render=False, material=self._material)
        for shape in ground.find_component_by_type(physx.PhysxRigidStaticComponent).get_collision_shapes():
            shape.set_collision_groups(BOARD)

    @property
    def scene(self) -> Any:
        """The SAPIEN scene, to which other things may be added."""
        return self._scene

    def step(self) -> None:
        """Make one step of the physics."""
        self._scene.step()

    def shapes(self, mesh: Mesh) -> list[Any]:
        """The collision shapes of a fragment: its hull, or those of its parts; the scene does not change.

        Raises:
            HullError: the mesh is too thin for a faithful hull.
        """
        shapes = []
        for corners in (corners for part in convex_parts(mesh) for corners in hull_pieces(part)):
            shape = convex_shape(corners, self._material)
            _check_cooked(corners, np.asarray(shape.vertices, dtype=np.float64) / COOKING_SCALE)
            shape.contact_offset = 0.002
            shape.rest_offset = 0.0
            shapes.append(shape)
        return shapes

    def add(self, fragment: Fragment, shapes: list[Any]) -> Any:
        """Add a body with these collision shapes for `fragment`, at rest; its frame is the fragment's frame F."""
        mesh = fragment.mesh
        body = physx.PhysxRigidDynamicComponent()
        for shape in shapes:
            body.attach(shape)
        X_FC = canonical_frame(mesh)
        spread = np.diag(X_FC.rotation.T @ covariance(mesh) @ X_FC.rotation)
        mass = self._settings.density * mesh.volume
        body.set_mass(mass)
        body.set_cmass_local_pose(sapien_pose(X_FC))
        body.set_inertia((mass * (spread.sum() - spread)).astype(np.float32))
        body.set_linear_damping(0.5)
        body.set_angular_damping(8.0)
        body.set_solver_position_iterations(10)
        body.set_solver_velocity_iterations(1)
        body.set_sleep_threshold(5e-5)  # asleep below 1 cm/s: a slice that is toppling is not
        body.set_max_depenetration_velocity(0.5)
        entity = sapien.Entity()
        entity.add_component(body)
        entity.set_pose(sapien_pose(fragment.X_WF))
        self._scene.add_entity(entity)
        return entity

    def remove(self, entity: Any) -> None:
        """Take a body out of the scene."""
        self._scene.remove_entity(entity)

    def pose(self, entity: Any) -> Pose:
        """Current X_WF of a body."""
        pose = entity.get_pose()
        return Pose.from_vector(np.concatenate([pose.p, pose.q]).astype(np.float64))

    def hold(self, entities: list[Any]) -> None:
        """Fix bodies in place until they are released."""
        for entity in entities:
            _body(entity).set_kinematic(True)

    def release(self, entities: list[Any]) -> None:
        """Let held bodies move again, from rest."""
        for entity in entities:
            body = _body(entity)
            body.set_kinematic(False)
            body.set_linear_velocity(np.zeros(3, dtype=np.float32))
            body.set_angular_velocity(np.zeros(3, dtype=np.float32))
            body.wake_up()

    def settle(self, entities: list[Any], watch: Callable[[int], None] | None = None) -> bool:
        """Step until all bodies sleep or `max_settle_seconds` have passed; whether all are still on the board.

        Args:
            entities: the bodies.
            watch: called after every step with its number, from 0.
        """
        for step in range(math.ceil(self._settings.max_settle_seconds / TIMESTEP)):
            self.step()
            if watch is not None:
                watch(step)
            if step % 8 == 7 and all(_body(entity).is_sleeping for entity in entities):
                break
        return all(np.linalg.norm(entity.get_pose().p) < MAX_DISTANCE for entity in entities)


def _check_cooked(corners: Floats, cooked: Floats) -> None:
    """Check that PhysX kept every corner to 0.1 mm: it replaces hulls thinner than about 0.03 mm without a warning."""
    outward = corners - corners.mean(axis=0)
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    error = float((np.einsum("ij,ij->i", corners, outward) - (outward @ cooked.T).max(axis=1)).max())
    if error > 1e-4:
        raise HullError(f"a fragment is too thin for the simulator: its hull would be {error * 1e3:.2g} mm off")


def _body(entity: Any) -> Any:
    return entity.find_component_by_type(physx.PhysxRigidDynamicComponent)
