"""Random cut sequences on every food, checking that products are closed, conserve volume and stay on their sides.

Planes are chosen to be difficult: a third are random, a third go through a vertex perpendicular to an axis, and a third
go through three vertices. Planes that miss or graze the fragment are counted and drawn again. The exit code is 1 if a
check fails.

Example:
    python benchmarks/cut_sequences.py --sequences 2000 --cuts 10 --seed 0
"""

import argparse
import sys
import time
from collections import Counter
from dataclasses import dataclass

import numpy as np
import trimesh

from cutgrammar import seeds
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.slicing import Missed, slice_mesh, solid_of
from cutgrammar.plugins import FOODS, load, names_in, reference_of

VOLUME_TOLERANCE = 1e-6
"""Relative tolerance for the sum of volumes over a sequence."""
SIDE_TOLERANCE = 1e-6
"""Tolerance for vertices on the wrong side of a plane [m]."""


@dataclass(frozen=True)
class Outcome:
    """The result of one sequence.

    Attributes:
        cuts: number of cuts.
        missed: number of planes that missed or grazed, by reason.
        fragments: number of fragments at the end.
        open: number of products that are not closed and consistently oriented, or that manifold3d refuses.
        volume_error: maximum relative error of the sum of all volumes after any cut.
        side_error: maximum distance of a vertex from its side [m].
    """

    cuts: int
    missed: Counter[str]
    fragments: int
    open: int
    volume_error: float
    side_error: float

    @property
    def passed(self) -> bool:
        """Whether all checks passed."""
        return self.open == 0 and self.volume_error <= VOLUME_TOLERANCE and self.side_error <= SIDE_TOLERANCE


def random_plane(mesh: Mesh, rng: np.random.Generator) -> Plane:
    """A plane through the mesh: random, through a vertex perpendicular to an axis, or through three vertices."""
    kind = rng.integers(3)
    corners = mesh.vertices[rng.choice(len(mesh.vertices), size=3, replace=False)]
    if kind == 0:
        share = rng.uniform(0.1, 0.9, size=3)
        point = mesh.vertices.min(axis=0) + share * np.ptp(mesh.vertices, axis=0)
        return Plane.through(point, rng.normal(size=3))
    if kind == 1:
        return Plane.through(corners[0], np.eye(3)[rng.integers(3)])
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    if np.linalg.norm(normal) < 1e-12:  # three collinear vertices
        normal = rng.normal(size=3)
    return Plane.through(corners[0], normal)


def is_closed(mesh: Mesh) -> bool:
    """Whether the mesh is closed and consistently oriented, and manifold3d accepts it as a solid."""
    seen = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    try:
        solid_of(mesh)
    except ValueError:
        return False
    return bool(seen.is_watertight and seen.is_winding_consistent and mesh.volume > 0.0)


def play(food: str, cuts: int, rng: np.random.Generator) -> Outcome:
    """Cut a random food `cuts` times; the fragment to cut is drawn with probability proportional to its volume."""
    fragments = [load(reference_of(FOODS, food))(rng)]
    whole, made, unclosed, volume_error, side_error = fragments[0].volume, 0, 0, 0.0, 0.0
    missed: Counter[str] = Counter()
    while made < cuts:
        volumes = np.array([fragment.volume for fragment in fragments])
        chosen = int(rng.choice(len(fragments), p=volumes / volumes.sum()))
        plane = random_plane(fragments[chosen], rng)
        sliced = slice_mesh(fragments[chosen], plane)
        if isinstance(sliced, Missed):
            missed[sliced.reason] += 1
            continue
        made += 1
        fragments[chosen : chosen + 1] = sliced.products
        unclosed += sum(not is_closed(product) for product in sliced.products)
        volume_error = max(volume_error, abs(sum(fragment.volume for fragment in fragments) / whole - 1.0))
        for product in sliced.above:
            side_error = max(side_error, float(-plane.distances(product.vertices).min()))
        for product in sliced.below:
            side_error = max(side_error, float(plane.distances(product.vertices).max()))
    return Outcome(made, missed, len(fragments), unclosed, volume_error, side_error)


def main() -> int:
    """Run all sequences and print the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sequences", type=int, default=2000, help="number of sequences over all foods")
    parser.add_argument("--cuts", type=int, default=10, help="number of cuts per sequence")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    foods, start, outcomes = names_in(FOODS), time.perf_counter(), []
    for i in range(options.sequences):
        food = foods[i % len(foods)]
        outcomes.append(play(food, options.cuts, seeds.stream(options.seed, "cut sequences", i)))
        if not outcomes[-1].passed:
            print(f"\nsequence {i} ({food}): {outcomes[-1]}")
        if (i + 1) % 20 == 0 or i + 1 == options.sequences:
            print(f"\r{i + 1}/{options.sequences} sequences, {time.perf_counter() - start:.0f} s", end="", flush=True)
    missed = sum((outcome.missed for outcome in outcomes), Counter())
    print(f"\n{len(outcomes)} sequences on {', '.join(foods)}")
    print(f"cuts made: {sum(o.cuts for o in outcomes)}; fragments at the end: {sum(o.fragments for o in outcomes)}")
    print(f"planes that missed or grazed: {dict(sorted(missed.items()))}")
    print(f"fragments that were not closed: {sum(o.open for o in outcomes)}")
    print(f"maximum relative volume error: {max(o.volume_error for o in outcomes):.3g} (limit {VOLUME_TOLERANCE:g})")
    print(f"maximum distance on the wrong side: {max(o.side_error for o in outcomes):.3g} m (limit {SIDE_TOLERANCE:g})")
    broken = sum(not outcome.passed for outcome in outcomes)
    print(f"sequences that failed a check: {broken}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
