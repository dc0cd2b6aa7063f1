"""Finds a trial of a run and a training trial that share a production, for the paper's Fig. 1.

The two must cut different foods, and the first production carried out in the trial must be one of the demonstration's,
whose fragments get their types from the classifier.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cutgrammar.demonstration import Demonstration
from cutgrammar.grammar.production import Production
from cutgrammar.learning.model import Model
from cutgrammar.trials.record import Record
from cutgrammar_dashboards.figures.layout.tree_picture import TreePicture, production_of
from cutgrammar_dashboards.figures.sharing_picture import demonstrated_tree

GOAL_SIZES = range(2, 13)
"""Numbers of goal fragments that can be drawn."""
BEST_GOAL_SIZE = 6
"""The number that is easiest to read."""


@dataclass(frozen=True, eq=False)
class Sharing:
    """A trial and a demonstration that share a production.

    Attributes:
        record: of the trial.
        foods: of the trial.
        demonstration: the training trial, of other foods.
        seen: its parse tree.
        production: that both contain.
    """

    record: Record
    foods: tuple[str, ...]
    demonstration: Demonstration
    seen: TreePicture
    production: Production


def find_sharing(
    records: Sequence[Record],
    foods_of: Callable[[int], Sequence[str]],
    model: Model,
    demonstrations: Sequence[Demonstration],
) -> Sharing | None:
    """The qualifying trial whose goal is nearest in size to `BEST_GOAL_SIZE`, with its smallest demonstration.

    Args:
        records: of trials whose cuts are explained.
        foods_of: from the number of a trial to its foods.
        model: that was used.
        demonstrations: that it was trained on.

    Returns:
        None if no trial qualifies.
    """
    small = sorted((d for d in demonstrations if len(d.goal) in GOAL_SIZES), key=lambda d: len(d.goal))
    trees = [demonstrated_tree(demonstration, _types(model, demonstration)) for demonstration in small]
    ranked = sorted(
        (record for record in records if record.goal_fragments in GOAL_SIZES),
        key=lambda record: (abs(record.goal_fragments - BEST_GOAL_SIZE), record.key),
    )
    for record in ranked:
        foods = tuple(foods_of(record.key.trial))
        first = next((event["production"] for event in record.events if event.get("production")), None)
        for demonstration, tree in zip(small, trees, strict=True):
            if set(foods) & set(demonstration.foods):
                continue
            for production in _productions(tree):
                if str(production) == first:
                    return Sharing(record, foods, demonstration, tree, production)
    return None


def _types(model: Model, demonstration: Demonstration) -> list[int]:
    z = np.array([model.features(fragment.mesh) for fragment in demonstration.fragments])
    return [int(c) for c in model.classifier.log_probabilities(z).argmax(axis=1)]


def _productions(drawn: TreePicture) -> list[Production]:
    of_nodes = (production_of(drawn.tree, node) for node in range(len(drawn.tree)))
    return [production for production in of_nodes if production is not None]
