"""Two questions about what is perceived of foods that the robot has not cut itself (IV-D).

- Seams: how strong is the clearest seam (`cutgrammar.perception.vision.seams`) of whole foods, which have none, and of
  foods that were cut once in place, with gaps of several widths? The table lists for several least strengths the share
  of whole foods that would be divided, and for every gap the share of cut foods whose seam is found, with more than
  95 % of the points on their side.
- Bent foods: mean IoU of completed fragments with the true ones, as the convex hull of their points and as they are
  completed; bananas, apples, aubergines and the foods of the trials, whole and cut. The true segmentation is given.

Data sets that judge should not be used here: the least strength was chosen on data seeds 0 to 9.

Example:
    python benchmarks/camera_shapes.py data-0 data-1 data-2
"""

import argparse
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cutgrammar.errors import InputError
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.geometry.slicing import Sliced, slice_mesh, solid_of
from cutgrammar.perception.vision.completion import MIRRORED, WHOLE, complete
from cutgrammar.perception.vision.convex_parts import hull
from cutgrammar.perception.vision.seams import MIN_POINTS, clearest
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings
from cutgrammar.storage.data_set import DataSet
from cutgrammar_pipelines.stages.progress import progress
from cutgrammar_sim import foods
from cutgrammar_sim.cameras.look import look

GAPS_MM = (1.0, 1.5, 2.0)
"""Gaps of foods that were cut in place."""
STRENGTHS = (8.0, 8.5, 9.0, 9.5)
"""Least strengths of a seam in the table."""
RIGHT = 0.95
"""Share of the points that a right seam has on their side."""
WHOLE_TRIALS, CUT_TRIALS = range(0, 110, 14), range(3, 110, 22)
"""Trials whose whole foods are looked at, and trials one of whose foods is cut."""
FAR = 0.03
"""Distance between the fragments of a food whose completion is measured [m]."""
MIN_SHARE = 0.05
"""A cut with a product below this share of its fragment is drawn again."""


def cut_in_place(food: Fragment, n_cuts: int, rng: np.random.Generator) -> list[tuple[Mesh, Floats]]:
    """Meshes of a food in W after steep cuts, mostly across its length, and how each moves for a gap of 1 m."""
    parts = [(food.mesh.moved(food.X_WF), np.zeros(3))]
    for _ in range(20):
        if len(parts) > n_cuts:
            break
        largest = int(np.argmax([mesh.volume for mesh, _ in parts]))
        mesh, shift = parts[largest]
        axes = np.linalg.svd(mesh.vertices - mesh.vertices.mean(axis=0), full_matrices=False)[2]
        extents = np.ptp(mesh.vertices @ axes.T, axis=0)
        normal = axes[0] if extents[0] > 1.3 * extents[1] else axes[int(rng.integers(2))]
        normal = (normal + rng.normal(scale=0.1, size=3)) * [1.0, 1.0, 0.3]
        normal /= np.linalg.norm(normal)
        along = mesh.vertices @ normal
        place = along.min() + rng.uniform(0.3, 0.7) * np.ptp(along)
        sliced = slice_mesh(mesh, Plane(normal, -float(place)), MIN_SHARE)
        if isinstance(sliced, Sliced):
            cut = [(part, shift) for part in sliced.products]
            level = 0.5 * normal * [1.0, 1.0, 0.0]
            parts = [
                (part, old + (level if part.centroid @ normal > place else -level))
                for part, old in parts[:largest] + cut + parts[largest + 1 :]
            ]
    return parts


def apart(parts: Sequence[tuple[Mesh, Floats]], gap: float) -> Configuration:
    """The parts with this gap [m]."""
    return tuple(
        Fragment(mesh.moved(Pose(np.eye(3), -mesh.centroid)), Pose(np.eye(3), mesh.centroid + gap * shift))
        for mesh, shift in parts
    )


def on_request(name: str, rng: np.random.Generator) -> Fragment:
    """A food on the board at a random heading."""
    mesh: Mesh = getattr(foods, name)(rng)
    rotation = Rotation.from_euler("z", rng.uniform(0.0, 360.0), degrees=True).as_matrix()
    lowest = (mesh.vertices @ rotation.T)[:, 2].min()
    return Fragment(mesh, Pose(rotation, np.array([0.0, 0.0, -lowest])))


def whole_foods(source: DataSet, seed: int) -> Iterator[tuple[str, Configuration]]:
    """The whole foods of some trials, and one of every food on request, each with a name."""
    for trial in WHOLE_TRIALS:
        yield "of trials", source.demonstration(trial).start
    for name in foods.ON_REQUEST:
        yield name, (on_request(name, stream(seed, "food", name)),)


def seams(sources: Sequence[DataSet], settings: Settings) -> str:
    """The table of seams."""
    whole, found = list[float](), defaultdict[float, list[tuple[float, bool]]](list)
    with progress("seams", len(sources)) as advance:
        for seed, source in enumerate(sources):
            for number, (_, start) in enumerate(whole_foods(source, seed)):
                sight = look(start, settings.cameras, stream(seed, "whole", number))
                for i in range(len(start)):
                    own = sight.owners == i
                    seam = clearest(sight.points[own], sight.normals[own])
                    if own.sum() >= MIN_POINTS and seam is not None:
                        whole.append(seam.strength)
            for trial in CUT_TRIALS:
                rng = stream(seed, "cut", trial)
                start = source.demonstration(trial).start
                parts = cut_in_place(start[int(rng.integers(len(start)))], 1, rng)
                for gap in GAPS_MM if len(parts) > 1 else ():
                    sight = look(apart(parts, 1e-3 * gap), settings.cameras, stream(seed, "cut", trial, "look"))
                    own = sight.owners >= 0
                    seam = clearest(sight.points[own], sight.normals[own])
                    if seam is not None:
                        same = (seam.plane_W.distances(sight.points[own]) > 0.0) == (sight.owners[own] == 0)
                        found[gap].append((seam.strength, max(same.mean(), 1.0 - same.mean()) > RIGHT))
            advance()
    lines = [f"{'least strength':16}{f'of {len(whole)} whole':>14}" + "".join(f"{gap:>8.1f} mm" for gap in GAPS_MM)]
    for least in STRENGTHS:
        shares = [np.mean([strength >= least and right for strength, right in found[gap]]) for gap in GAPS_MM]
        divided = sum(strength >= least for strength in whole)
        lines.append(f"{least:<16.1f}{divided:>14d}" + "".join(f"{share:>11.2f}" for share in shares))
    lines.append(f"strongest plane of a whole food: {max(whole):.2f}; cut foods: {len(found[GAPS_MM[0]])}")
    return "\n".join(lines)


def bent(sources: Sequence[DataSet], settings: Settings) -> str:
    """The table of completions."""
    rows = defaultdict[str, list[tuple[float, float]]](list)

    def add(name: str, now: Configuration, rng: np.random.Generator, mirrored: float) -> None:
        sight = look(now, settings.cameras, rng)
        for i, fragment in enumerate(now):
            own = sight.owners == i
            completed = complete(sight.points[own], sight.normals[own], mirrored) if own.sum() > 60 else None
            if completed is not None:
                true, closed = fragment.mesh.moved(fragment.X_WF), hull(completed.vertices)
                rows[name].append((_iou(closed or completed, true), _iou(completed, true)))

    with progress("bent foods", len(sources)) as advance:
        for seed, source in enumerate(sources):
            for number, (name, start) in enumerate(whole_foods(source, seed)):
                add(f"{name}, whole", start, stream(seed, "whole", number), WHOLE)
                rng = stream(seed, "fragments", number)
                cut = apart(cut_in_place(start[0], 1 + number % 3, rng), FAR)
                add(f"{name}, cut", cut, rng, MIRRORED)
            advance()
    lines = [f"{'foods':20}{'number':>8}{'hull':>8}{'used':>8}{'changed':>9}"]
    for name, ious in sorted(rows.items()):
        hulls, used = np.array(ious).T
        changed = float(np.mean(np.abs(hulls - used) > 1e-6))
        lines.append(f"{name:20}{len(used):>8d}{hulls.mean():>8.3f}{used.mean():>8.3f}{changed:>9.2f}")
    return "\n".join(lines)


def _iou(a: Mesh, b: Mesh) -> float:
    one, other = solid_of(a), solid_of(b)
    both = float((one ^ other).volume())
    return both / (a.volume + b.volume - both)


def main() -> int:
    """Measure and print; the exit code is 2 for invalid input."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, nargs="+", metavar="DATA", help="data sets whose foods are used")
    parser.add_argument("--only", choices=("seams", "bent"), help="one of the tables only")
    chosen = parser.parse_args()
    try:
        sources = [DataSet.open(path) for path in chosen.data]
        for name, table in (("seams", seams), ("bent", bent)):
            if chosen.only in (None, name):
                print(table(sources, Settings()), flush=True)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
