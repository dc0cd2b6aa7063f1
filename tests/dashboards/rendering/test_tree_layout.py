"""Positions of the nodes of parse trees."""

import numpy as np
import pytest

from cutgrammar.interfaces import TreeNode
from cutgrammar_dashboards.rendering.tree_layout import positions


def test_parents_are_above_the_middle_of_their_children():
    tree = (TreeNode(None, None), TreeNode(0, 1), TreeNode(0, 2), TreeNode(1, 3), TreeNode(1, 3), TreeNode(1, 4))
    place = positions(tree, across=10.0, down=5.0)
    assert place[:, 1].tolist() == [0, 5, 5, 10, 10, 10]
    assert place[1, 0] == place[3:6, 0].mean()
    assert place[3:6, 0].tolist() == [0, 10, 20]
    assert place[2, 0] == 30.0


def test_no_two_nodes_of_one_depth_overlap(rng):
    for _ in range(30):
        tree = [TreeNode(None, None)]
        tree += [TreeNode(int(rng.integers(i + 1)), 0) for i in range(40)]
        place = positions(tree, across=1.0, down=1.0)
        for depth in np.unique(place[:, 1]):
            x = np.sort(place[place[:, 1] == depth, 0])
            assert (np.diff(x) >= 1.0 - 1e-12).all()


def test_a_child_before_its_parent_is_refused():
    with pytest.raises(ValueError, match="node 1 comes before its parent 2"):
        positions((TreeNode(None, None), TreeNode(2, 0), TreeNode(0, 0)))


def test_a_deep_tree_is_laid_out_without_recursion():
    tree = [TreeNode(None, None), *(TreeNode(i, 0) for i in range(5000))]
    assert positions(tree)[-1].tolist() == [0.0, 5000 * 90.0]
