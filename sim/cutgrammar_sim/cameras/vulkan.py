"""Depth images by SAPIEN's renderer, which needs a Vulkan device: a graphics card, or a software driver.

The rendered scene holds no physics and is built anew for every look, so rendering cannot change the simulated world.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from cutgrammar.geometry.camera import Camera
from cutgrammar.geometry.fragment import Configuration, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar_sim.cameras.camera import BACKGROUND, MAX_DEPTH, OTHER, Image, Mask, board_depth
from cutgrammar_sim.physics.engine import render, sapien, sapien_pose

MIN_DEPTH = 0.01
"""Nothing nearer than this depth is rendered [m]."""
SAPIEN_AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]).T
"""Axes of SAPIEN's camera (x into the scene, y left, z up) in C."""

HOW_TO_INSTALL = (
    "on Debian, `apt-get install chromium libvulkan1` installs a software driver; "
    "VK_ICD_FILENAMES then names the vk_swiftshader_icd.json that `dpkg -L chromium` lists"
)


class NoVulkanError(RuntimeError):
    """This machine has no Vulkan device."""


def render_system() -> Any:
    """A render system for one scene.

    Raises:
        NoVulkanError: there is no Vulkan device.
    """
    try:
        return render.RenderSystem()
    except RuntimeError as error:
        raise NoVulkanError(str(error)) from None


class Vulkan:
    """A depth renderer with SAPIEN's 'trivial' shader, which gives positions and no light.

    Raises:
        NoVulkanError: there is no Vulkan device.
    """

    name = "vulkan"

    def __init__(self) -> None:
        self._system = render_system()  # SAPIEN keeps its device and compiled shaders while any system is alive

    def images(self, cameras: Sequence[Camera], now: Configuration, others: Sequence[Mesh] = ()) -> list[Image]:
        """The images that the cameras take of the board, the fragments and `others`, whose frame is W.

        Raises:
            TypeError: a fragment is known as a point cloud only.
        """
        render.set_camera_shader_dir("trivial")
        scene = sapien.Scene([render_system()])
        owners = {}
        for index, fragment in enumerate(now):
            owners[add_mesh(scene, fragment.mesh, fragment.X_WF, render.RenderMaterial())] = index
        for other in others:
            owners[add_mesh(scene, other, Pose.identity(), render.RenderMaterial())] = OTHER
        owner_of = np.full(max(owners, default=0) + 1, BACKGROUND)
        owner_of[list(owners)] = list(owners.values())
        components = [add_camera(scene, camera) for camera in cameras]
        scene.update_render()
        images = []
        for camera, component in zip(cameras, components, strict=True):
            component.take_picture()
            depth = -component.get_picture("Position")[..., 2].astype(np.float64)
            entity = component.get_picture("Segmentation")[..., 1].astype(np.int64)
            board = board_depth(camera)
            shown: Mask = (entity > 0) & ((depth < board) | (board == 0.0))
            images.append(Image(np.where(shown, depth, board), np.where(shown, owner_of[entity], BACKGROUND)))
        return images


def add_mesh(scene: Any, mesh: Mesh, X_WF: Pose, material: Any) -> int:
    """Add a flat-shaded mesh to a rendered scene; returns the id that its pixels have in an image."""
    corners = mesh.triangles.reshape(-1, 3).astype(np.float32)
    a, b, c = np.moveaxis(mesh.triangles, 1, 0)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    body = render.RenderBodyComponent()
    body.attach(
        render.RenderShapeTriangleMesh(
            corners,
            np.arange(len(corners), dtype=np.uint32).reshape(-1, 3),
            np.repeat(normals, 3, axis=0).astype(np.float32),
            np.zeros((len(corners), 2), dtype=np.float32),
            material,
        )
    )
    entity = sapien.Entity()
    entity.add_component(body)
    entity.set_pose(sapien_pose(X_WF))
    scene.add_entity(entity)
    return int(entity.per_scene_id)


def add_camera(scene: Any, camera: Camera) -> Any:
    """Add a camera to a rendered scene."""
    component = render.RenderCameraComponent(camera.width, camera.height)
    component.set_perspective_parameters(
        MIN_DEPTH, MAX_DEPTH, camera.focal, camera.focal, camera.width / 2.0, camera.height / 2.0, 0.0
    )
    entity = sapien.Entity()
    entity.add_component(component)
    entity.set_pose(sapien_pose(Pose(camera.X_WC.rotation @ SAPIEN_AXES, camera.X_WC.position)))
    scene.add_entity(entity)
    return component
