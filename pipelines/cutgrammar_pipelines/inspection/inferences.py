"""Collects the data for the picture of one inference: fragments, goal, parse tree, cut and products."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from cutgrammar.events import CutMade, Planned
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.interfaces import Cut, Explanation
from cutgrammar.learning.model import Model
from cutgrammar.learning.typical_fragments import TypicalFragment
from cutgrammar_dashboards.figures.inference_picture import Inference
from cutgrammar_dashboards.recording.fragment_names import shape_digest
from cutgrammar_workers.trial_worker import TrialTrace


def inference_of(trace: TrialTrace, index: int, model: Model, typical: Sequence[TypicalFragment]) -> Inference:
    """The inference of one of the cuts that were explained and made at the first attempt.

    Args:
        trace: of a trial.
        index: of the cut among these, from 0; the last one if there are fewer.
        model: that planned the cut.
        typical: the typical fragment of each of its types.

    Raises:
        ValueError: there is no such cut.
    """
    now = trace.start
    explained: list[tuple[Configuration, Cut, Explanation, Configuration]] = []
    for event, following in pairwise(trace.events):
        if isinstance(event, Planned) and event.cut.explanation and isinstance(following, CutMade):
            explained.append((now, event.cut, event.cut.explanation, following.configuration))
        if isinstance(event, CutMade):
            now = event.configuration
    if not explained:
        raise ValueError(f"{trace.record.key.name} has no cut that was explained and made at the first attempt")
    before, cut, why, result = explained[min(index, len(explained) - 1)]
    unchanged = {shape_digest(fragment) for fragment in before}
    return Inference(
        now=before,
        goal=trace.goal,
        log_current=_log_types(model, before),
        log_goal=_log_types(model, trace.goal),
        cut=cut,
        why=why,
        products=tuple(fragment for fragment in result if shape_digest(fragment) not in unchanged),
        grammar=model.grammar,
        typical=typical,
    )


def _log_types(model: Model, fragments: Configuration) -> Floats:
    return model.classifier.log_probabilities(np.array([model.features(fragment.shape) for fragment in fragments]))
