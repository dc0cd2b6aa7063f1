import numpy as np
import pytest

from cutgrammar.geometry.facets import facets_of
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.slicing import slice_mesh
from simple_shapes import box_mesh


def test_a_box_has_six_outward_facets_for_any_triangulation(remeshed, random_pose):
    mesh, X = box_mesh(0.02, 0.03, 0.05), random_pose()
    for facets, pose in ((facets_of(mesh), None), (facets_of(remeshed(mesh, X)), X)):
        assert len(facets) == 6
        assert [facet.area for facet in facets] == pytest.approx([15e-4, 15e-4, 10e-4, 10e-4, 6e-4, 6e-4])
        assert sum(facet.area * facet.plane_F.normal for facet in facets) == pytest.approx(np.zeros(3), abs=1e-12)
        centre = np.zeros(3) if pose is None else pose.position
        assert all(facet.plane_F.distances(centre) < 0.0 for facet in facets)


def test_a_curved_surface_has_no_facets_and_a_cut_adds_one_to_each_product(lump):
    assert facets_of(lump) == ()
    plane = Plane.through(lump.centroid, np.array([0.2, -0.3, 1.0]))
    sliced = slice_mesh(lump, plane)
    for product, sign in ((sliced.above[0], -1.0), (sliced.below[0], 1.0)):
        (facet,) = facets_of(product)
        assert facet.plane_F.to_vector() == pytest.approx(sign * plane.to_vector(), abs=1e-9)
