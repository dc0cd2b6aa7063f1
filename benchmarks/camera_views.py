"""Coverage, accuracy and speed of the two depth cameras on demonstrated configurations.

The configurations are the goals of two demonstrations of each of the six setups, at rest on the board. A surface point
counts as seen if the straight line from it to a camera is free. Distances are those between the fused points and the
surface of their fragments. Times are processor times of a look, including all processing after the images.

Example:
    python benchmarks/camera_views.py --picture views.png
"""

import argparse
import time

import numpy as np
import trimesh

from cutgrammar.demonstration import CATEGORIES
from cutgrammar.geometry.rays import RayCaster
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.seeds import stream
from cutgrammar.settings import CameraSettings, Settings
from cutgrammar.trials.setups import SETUPS
from cutgrammar_sim import foods
from cutgrammar_sim.cameras.camera import two_cameras
from cutgrammar_sim.cameras.look import look
from cutgrammar_sim.cameras.noise import noisy
from cutgrammar_sim.cameras.rays import Rays
from cutgrammar_sim.cameras.vulkan import NoVulkanError, Vulkan
from cutgrammar_sim.demonstrator.demonstrate import make_demonstration
from cutgrammar_sim.worlds.board import Board

SEED = 7


def scenes():
    """The setup and configuration of each scene."""
    known = {name: getattr(foods, name) for name in foods.PROPORTIONS}
    for setup in SETUPS.values():
        for trial in range(2):
            categories = tuple(CATEGORIES[(trial + i) % len(CATEGORIES)] for i in range(setup.categories))
            made = make_demonstration(trial, setup, categories, known, SEED, Settings().demonstrator)
            board = Board(Settings().world)
            board.reset(made.goal)
            yield setup.name, board.truth()


def seen_share(now):
    """Shares of the surface seen by a camera: of the whole surface, and of the part that does not face the board."""
    corners = [fragment.X_WF.apply(fragment.mesh.triangles.reshape(-1, 3)) for fragment in now]
    caster = RayCaster(np.concatenate(corners).reshape(-1, 3, 3))
    seen, areas, up = [], [], []
    for fragment in now:
        cloud = sample_surface(fragment.mesh, 500)
        points, normals = fragment.X_WF.apply(cloud.points), fragment.X_WF.rotate(cloud.normals)
        free = np.zeros(len(points), dtype=bool)
        for camera in two_cameras(CameraSettings()):
            towards = camera.X_WC.position - points
            blocked = caster.blocked(points + 2e-5 * normals, towards)
            free |= ~blocked & (np.einsum("ij,ij->i", towards, normals) > 0)
        area = np.linalg.norm(np.cross(*np.diff(fragment.mesh.triangles, axis=1).transpose(1, 0, 2)), axis=1).sum()
        seen.append(free)
        areas.append(np.full(len(points), area))
        up.append(normals[:, 2] > -0.5)
    seen, areas, up = (np.concatenate(parts) for parts in (seen, areas, up))
    return (seen * areas).sum() / areas.sum(), (seen * areas)[up].sum() / areas[up].sum()


def off_surface(sight, now):
    """(n,) distance of every point from the surface of its fragment [m], and (n,) cosine of its normal's error."""
    off, turned = [], []
    for i, fragment in enumerate(now):
        own = sight.owners == i
        corners = fragment.X_WF.apply(fragment.mesh.triangles.reshape(-1, 3)).reshape(-1, 3, 3)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        for chunk in np.array_split(np.flatnonzero(own), max(1, own.sum() * len(corners) // 100_000)):
            p = np.repeat(sight.points[chunk], len(corners), axis=0)
            nearest = trimesh.triangles.closest_point(np.tile(corners, (len(chunk), 1, 1)), p)
            far = np.linalg.norm(nearest - p, axis=1).reshape(len(chunk), len(corners))
            off.append(far.min(axis=1))
            turned.append(np.einsum("ij,ij->i", normals[far.argmin(axis=1)], sight.normals[chunk]))
    return np.concatenate(off), np.concatenate(turned)


def report():
    """Measure and print everything."""
    print("setup  fragments  surface seen  of what does not face down")
    shares, all_scenes = [], list(scenes())
    for name, now in all_scenes:
        shares.append(seen_share(now))
        print(f"{name:6} {len(now):9d}  {shares[-1][0]:12.3f}  {shares[-1][1]:10.3f}")
    print(f"{'mean':6} {'':9}  {np.mean(shares, axis=0)[0]:12.3f}  {np.mean(shares, axis=0)[1]:10.3f}")
    for noise in (0.0, CameraSettings().depth_noise):
        settings = CameraSettings(renderer="rays", depth_noise=noise)
        sights = [(look(now, settings, stream(SEED, i)), now) for i, (_, now) in enumerate(all_scenes)]
        off, turned = (np.concatenate(part) for part in zip(*(off_surface(*pair) for pair in sights), strict=True))
        mm = " ".join(f"{value:.2f}" for value in np.percentile(off * 1e3, [50, 90, 99]))
        deg = " ".join(f"{value:.0f}" for value in np.percentile(np.degrees(np.arccos(turned.clip(-1, 1))), [50, 90]))
        foreign = np.mean(np.concatenate([sight.owners < 0 for sight, _ in sights]))
        unseen = sum(np.sum(np.bincount(s.owners[s.owners >= 0], minlength=len(now)) < 20) for s, now in sights)
        print(
            f"noise {noise * 1e3:.0f} mm at 1 m: points {np.mean([len(s.points) for s, _ in sights]):.0f}; off the "
            f"surface {mm} mm (median, 90 %, 99 %); normals off {deg} degrees (median, 90 %); of no fragment "
            f"{foreign:.2%}; fragments with fewer than 20 points: {unseen} of {sum(len(now) for _, now in all_scenes)}"
        )
    renderers = [Rays()]
    try:
        renderers.append(Vulkan())
    except NoVulkanError as error:
        print(f"no Vulkan device: {error}")
    now = min((now for _, now in all_scenes), key=lambda now: abs(len(now) - 20))
    for renderer in renderers:
        cameras, settings = two_cameras(CameraSettings()), CameraSettings()
        renderer.images(cameras, now)
        started = time.process_time()
        for _ in range(5):
            renderer.images(cameras, now)
        images = (time.process_time() - started) / 5
        started = time.process_time()
        for i in range(5):
            look(now, settings, stream(SEED, i), render=renderer)
        whole = (time.process_time() - started) / 5
        print(
            f"{renderer.name}: {images * 1e3:.0f} ms for both images of {len(now)} fragments, {whole * 1e3:.0f} a look"
        )


def picture(path):
    """The two depth images of one configuration with noise, and the fused cloud in its owners' colours, from above."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    now = max((now for _, now in scenes()), key=len)
    settings = CameraSettings(renderer="rays")
    sight = look(now, settings, stream(SEED, "picture"))
    figure, axes = plt.subplots(1, 3, figsize=(14, 4.2), layout="constrained")
    rng = stream(SEED, "picture")
    for number, (camera, image) in enumerate(
        zip(two_cameras(settings), Rays().images(two_cameras(settings), now), strict=True)
    ):
        depth = noisy(image, camera, settings, rng).depth[140:340, 180:460]
        shown = axes[number].imshow(np.where(depth > 0.0, depth, np.nan), cmap="viridis", vmin=0.80, vmax=1.08)
        axes[number].set_title(f"camera {number + 1}: depth [m], middle of the image; white: none", fontsize=9)
        axes[number].axis("off")
    figure.colorbar(shown, ax=axes[:2], shrink=0.75)
    axes[2].scatter(*(1e3 * sight.points[:, :2].T), c=sight.owners % 20, cmap="tab20", s=0.6)
    axes[2].set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    axes[2].set_title(f"fused: {len(sight.points)} points of {len(now)} fragments, from above", fontsize=9)
    figure.savefig(path, dpi=80)


def main():
    """Measure, or draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--picture", metavar="FILE", help="draw the views of one configuration instead")
    path = parser.parse_args().picture
    if path:
        picture(path)
    else:
        report()


if __name__ == "__main__":
    main()
