"""Random cut sequences on every food: is every fragment closed, no volume lost, every corner on its side?

    python benchmarks/cut_sequences.py [--sequences 2000] [--cuts 10] [--seed 0]

Planes are drawn to be awkward: a third at random, a third along the axes through corners of the fragment, a third
through three of its corners. A plane that misses or grazes is an outcome and another is drawn. Ends with exit code 1
if any law is broken.
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
"""Relative, of the whole sequence."""
SIDE_TOLERANCE = 1e-6
"""How far a corner may lie on the wrong side [m]."""


@dataclass(frozen=True)
class Outcome:
    """What one sequence showed.

    Attributes:
        cuts: cuts made.
        missed: planes that missed or grazed, by reason.
        fragments: fragments at the end.
        open: products that were not closed and consistently wound, or that manifold3d refuses.
        volume_error: greatest relative error of the sum of all volumes after any cut.
        side_error: greatest distance of a corner from its side [m].
    """

    cuts: int
    missed: Counter[str]
    fragments: int
    open: int
    volume_error: float
    side_error: float

    @property
    def sound(self) -> bool:
        """All laws held."""
        return self.open == 0 and self.volume_error <= VOLUME_TOLERANCE and self.side_error <= SIDE_TOLERANCE


def random_plane(mesh: Mesh, rng: np.random.Generator) -> Plane:
    """A plane through the mesh: any, along an axis through a corner, or through three corners."""
    kind = rng.integers(3)
    corners = mesh.vertices[rng.choice(len(mesh.vertices), size=3, replace=False)]
    if kind == 0:
        share = rng.uniform(0.1, 0.9, size=3)
        point = mesh.vertices.min(axis=0) + share * np.ptp(mesh.vertices, axis=0)
        return Plane.through(point, rng.normal(size=3))
    if kind == 1:
        return Plane.through(corners[0], np.eye(3)[rng.integers(3)])
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    if np.linalg.norm(normal) < 1e-12:  # three corners in a line
        normal = rng.normal(size=3)
    return Plane.through(corners[0], normal)


def is_closed(mesh: Mesh) -> bool:
    """Every edge has two faces that agree on the outside, and manifold3d takes it for a solid."""
    seen = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    try:
        solid_of(mesh)
    except ValueError:
        return False
    return bool(seen.is_watertight and seen.is_winding_consistent and mesh.volume > 0.0)


def play(food: str, cuts: int, rng: np.random.Generator) -> Outcome:
    """Cut a random food `cuts` times, a random fragment each time (larger ones more often)."""
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
    """Play all sequences and print what they showed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sequences", type=int, default=2000, help="how many sequences, shared over all foods")
    parser.add_argument("--cuts", type=int, default=10, help="cuts a sequence")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    foods, start, outcomes = names_in(FOODS), time.perf_counter(), []
    for i in range(options.sequences):
        food = foods[i % len(foods)]
        outcomes.append(play(food, options.cuts, seeds.stream(options.seed, "cut sequences", i)))
        if not outcomes[-1].sound:
            print(f"\nsequence {i} ({food}): {outcomes[-1]}")
        if (i + 1) % 20 == 0 or i + 1 == options.sequences:
            print(f"\r{i + 1}/{options.sequences} sequences, {time.perf_counter() - start:.0f} s", end="", flush=True)
    missed = sum((outcome.missed for outcome in outcomes), Counter())
    print(f"\n{len(outcomes)} sequences on {', '.join(foods)}")
    print(f"cuts made: {sum(o.cuts for o in outcomes)}; fragments at the end: {sum(o.fragments for o in outcomes)}")
    print(f"planes that missed or grazed: {dict(sorted(missed.items()))}")
    print(f"fragments that were not closed: {sum(o.open for o in outcomes)}")
    print(f"greatest relative volume error: {max(o.volume_error for o in outcomes):.3g} (limit {VOLUME_TOLERANCE:g})")
    print(
        f"greatest distance to the wrong side: {max(o.side_error for o in outcomes):.3g} m (limit {SIDE_TOLERANCE:g})"
    )
    broken = sum(not outcome.sound for outcome in outcomes)
    print(f"sequences that broke a law: {broken}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
