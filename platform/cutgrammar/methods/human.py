"""The method `human`: the cuts that people made who were shown the goal, the upper bound of IV-B1.

They saw what a planner is given, the goal, and made every cut by hand (`cutgrammar record --reproduce`). Their cuts are
carried out again in the world of the evaluation, in the order in which they were made and without those that were
undone; on the bench this gives the fragments that they saved. Goals are in place, because that is how they were shown.
"""

from cutgrammar.methods.controls import ReplayPlanner
from cutgrammar.methods.method import Method

HUMAN = Method(
    "human",
    lambda context: ReplayPlanner(context.require_reproduction()),
    description="people who saw the goal and cut by hand, on the goals that somebody reproduced",
    kind="person",
    goals=("in-place",),
    is_deterministic=True,
)
