"""1. Fragments, planes and overlap: cut a carrot and compare the fragments.

Run: python docs/examples/01_cut_a_fragment.py
"""

import numpy as np

from cutgrammar import Missed, Plane, Solid, best_match, canonical_frame, extents, slice_mesh
from cutgrammar_sim import carrot

mesh = carrot(np.random.default_rng(0))
low, high = extents(mesh, canonical_frame(mesh))
print(f"a carrot of {mesh.volume * 1e6:.0f} ml, {(high - low)[::-1] * 1e3} mm")

# A plane is n.v + d = 0, here across the carrot at its centroid.
cut = slice_mesh(mesh, Plane.through(mesh.centroid, np.array([1.0, 0.0, 0.0])))
assert not isinstance(cut, Missed), cut.reason
for product in cut.products:
    print(f"  a fragment of {product.volume * 1e6:.0f} ml")

# Volumes add up, and a plane that misses is an outcome, not an error.
assert abs(sum(p.volume for p in cut.products) - mesh.volume) < 1e-9 * mesh.volume
print("  far away:", slice_mesh(mesh, Plane(np.array([1.0, 0.0, 0.0]), 1.0)))

# How well do two configurations match? Canonical frames make it blind to pose and order.
halves = [Solid(product) for product in cut.products]
print(f"halves against themselves: {best_match(halves, halves[::-1]).strict:.3f}")
print(f"one half against both:     {best_match(halves[:1], halves).strict:.3f} strict")
