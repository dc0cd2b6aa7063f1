"""What a plan shares with a demonstration, the paper's Fig. 1: which trial of a run and which training trial show it.

A pair qualifies if the two cut different foods and the first production carried out in the trial is one of the
demonstration's, once its fragments are typed by the classifier.
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

LEAVES = range(2, 13)
"""Numbers of fragments of a goal that is drawn."""
EASY = 6
"""The number that is read most easily."""


@dataclass(frozen=True, eq=False)
class Sharing:
    """A trial and a demonstration that share a production.

    Attributes:
        record: of the trial.
        foods: that it cuts.
        demonstration: of other foods.
        seen: its parse tree.
        production: that both hold.
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
    """The first trial that qualifies with a goal nearest in size to `EASY`; None where none does.

    Its demonstration is the one with the fewest fragments.

    Args:
        records: of trials whose cuts are explained.
        foods_of: what a trial cuts, by its number.
        model: that was used.
        demonstrations: that it learned from.
    """
    small = sorted((one for one in demonstrations if len(one.goal) in LEAVES), key=lambda one: len(one.goal))
    trees = [demonstrated_tree(one, _types(model, one)) for one in small]
    ranked = sorted(
        (record for record in records if record.goal_fragments in LEAVES),
        key=lambda record: (abs(record.goal_fragments - EASY), record.key),
    )
    for record in ranked:
        foods = tuple(foods_of(record.key.trial))
        carried_out = next((event["production"] for event in record.events if event.get("production")), None)
        for one, tree in zip(small, trees, strict=True):
            for production in _productions(tree) if not set(foods) & set(one.foods) else ():
                if str(production) == carried_out:
                    return Sharing(record, foods, one, tree, production)
    return None


def _types(model: Model, demonstration: Demonstration) -> list[int]:
    z = np.array([model.features(fragment.mesh) for fragment in demonstration.fragments])
    return [int(c) for c in model.classifier.log_probabilities(z).argmax(axis=1)]


def _productions(drawn: TreePicture) -> list[Production]:
    found = [production_of(drawn.tree, node) for node in range(len(drawn.tree))]
    return [production for production in found if production is not None]
