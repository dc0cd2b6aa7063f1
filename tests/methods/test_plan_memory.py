"""What is left of a plan after a cut competes in the next step."""

from dataclasses import replace

import numpy as np
import trimesh

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.inference.attributes import Attributes
from cutgrammar.inference.parse_tree import ParseTree
from cutgrammar.inference.posterior import log_posterior
from cutgrammar.inference.problem import Problem
from cutgrammar.inference.reachable import derivations
from cutgrammar.inference.search import GroundedTree, SearchResult
from cutgrammar.methods.grammar import Plan
from cutgrammar.methods.plan_memory import LeftOver, with_left_over

GRAMMAR = Grammar(2, {Production(0, (0, 1)): 0.5, Production(0, (1, 1)): 0.5}, (0.5, 0.5))
WHOLE = ParseTree(np.array([0, 0, 1, 1, 1]), np.array([-1, 0, 1, 1, 0]), np.array([0, 1, -1, -1, -1]))
"""c0 -> (c0 -> c1 c1) c1"""


def bar(length):
    made = trimesh.creation.box([0.01, 0.01, length])
    return Fragment(Mesh(made.vertices, made.faces), Pose(np.eye(3), np.array([0.0, 0.0, length])))


def plan_of(now, goal, tree, grounding):
    volumes = [np.array([f.mesh.volume for f in fragments]) for fragments in (goal, now)]
    problem = Problem(
        GRAMMAR,
        np.log(np.full((len(now), 2), 0.5)),
        np.log(np.full((len(goal), 2), 0.5)),
        np.array([f.p_WC for f in goal]),
        0.1,
        Attributes(*volumes, np.log([4e-6, 2e-6]), np.full(2, 0.5)),
    )
    derived = derivations(GRAMMAR, 5)
    posterior = log_posterior(problem, derived, tree, grounding)
    found = GroundedTree(tree, grounding, posterior.log)
    result = SearchResult(tree, grounding, posterior, 0, (posterior.log,), 1, 0, (found,))
    return Plan(now, goal, np.zeros((len(now), 17)), result, problem, derived)


GOAL = (bar(0.03), bar(0.02), bar(0.05))
FIRST = plan_of((bar(0.10),), GOAL, WHOLE, np.array([0, 1, 2]))


def left_over():
    best = FIRST.result.trees[0]
    return LeftOver.after(FIRST, best, 0, [1, 4], [5e-6, 5.1e-6])


def second_plan(now):
    """A plan with a poor grounding."""
    tree = ParseTree(np.array([0, 1, 1, 1]), np.array([-1, 0, 0, -1]), np.array([1, -1, -1, -1]))
    return plan_of(now, GOAL, tree, np.array([2, 0, 1]))


def test_the_left_over_wins_where_it_is_better():
    made = (bar(0.05), bar(0.05))
    plan = with_left_over(second_plan(made), left_over(), 0, np.random.default_rng(0))
    np.testing.assert_array_equal(plan.result.grounding, [0, 1, 2])
    assert plan.result.posterior.log > second_plan(made).result.posterior.log


def test_it_does_not_compete_where_other_fragments_came_out():
    for made in ((bar(0.09), bar(0.01)), (bar(0.05), bar(0.03), bar(0.02))):
        plan = second_plan(made[:2])
        assert with_left_over(replace(plan, now=made), left_over(), 0, np.random.default_rng(0)).result is plan.result


def test_it_does_not_compete_for_another_goal():
    plan = replace(second_plan((bar(0.05), bar(0.05))), goal=(bar(0.03), bar(0.02), bar(0.05)))
    assert with_left_over(plan, left_over(), 0, np.random.default_rng(0)) is plan


def test_a_fragment_that_was_not_cut_is_known_by_its_shape():
    rest = bar(0.05)
    first = plan_of((bar(0.05), rest), GOAL, second_plan((rest, rest)).result.tree, np.array([0, 1, 2]))
    left = LeftOver.after(first, first.result.trees[0], 0, [1, 2], [3e-6, 2e-6])
    found = left.below((bar(0.02), rest, bar(0.03)))
    np.testing.assert_array_equal(found.grounding, [1, 2, 0])
