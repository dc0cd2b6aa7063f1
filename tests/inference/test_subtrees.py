"""Parse trees taken apart and put together again."""

import numpy as np
import pytest

from cutgrammar.inference.parse_tree import ParseTree
from cutgrammar.inference.search import GroundedTree
from cutgrammar.inference.subtrees import side_by_side, subtree

TREE = ParseTree(np.array([0, 1, 2, 2, 2, 3]), np.array([-1, 0, 1, 1, 0, -1]), np.array([0, 1, -1, -1, -1, -1]))
FOUND = GroundedTree(TREE, np.array([3, 0, 1, 2]), -5.0)


def test_a_subtree_keeps_types_productions_and_grounding():
    part = subtree(FOUND, 1)
    np.testing.assert_array_equal(part.tree.types, [1, 2, 2])
    np.testing.assert_array_equal(part.tree.parents, [-1, 0, 0])
    np.testing.assert_array_equal(part.tree.productions, [1, -1, -1])
    np.testing.assert_array_equal(part.grounding, [3, 0])
    np.testing.assert_array_equal(subtree(FOUND, 5).grounding, [2])


def test_the_subtrees_of_all_roots_make_the_tree_again():
    whole = side_by_side([subtree(FOUND, int(root)) for root in TREE.roots])
    for name in ("types", "parents", "productions"):
        np.testing.assert_array_equal(getattr(whole.tree, name), getattr(TREE, name))
    np.testing.assert_array_equal(whole.grounding, FOUND.grounding)


def test_log_posteriors_add_up():
    assert side_by_side([FOUND, FOUND]).log_posterior == pytest.approx(-10.0)
