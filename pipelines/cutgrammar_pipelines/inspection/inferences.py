"""An inference of a trial as it is drawn: what was there, what was wanted, the parse tree, the cut and what it made."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from cutgrammar.events import CutMade, Planned
from cutgrammar.geometry.arrays import Floats
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.learning.model import Model
from cutgrammar.learning.typical_fragments import TypicalFragment
from cutgrammar_dashboards.figures.inference_picture import Inference
from cutgrammar_dashboards.recording.fragment_names import shape_digest
from cutgrammar_workers.world_actor import Story


def inference_of(story: Story, wanted: int, model: Model, typical: Sequence[TypicalFragment]) -> Inference:
    """The inference for one of the cuts that were explained and made at the first attempt.

    Args:
        story: of a trial.
        wanted: which of them, from 0; the last where there are fewer.
        model: that inferred.
        typical: the typical fragment of each of its types.

    Raises:
        ValueError: there is none.
    """
    now, found = story.start, []
    for event, after in pairwise(story.events):
        if isinstance(event, Planned) and event.cut.explanation and isinstance(after, CutMade):
            found.append((now, event.cut, event.cut.explanation, after.configuration))
        if isinstance(event, CutMade):
            now = event.configuration
    if not found:
        raise ValueError(f"{story.record.key.name} holds no cut that was explained and made")
    before, cut, why, after_cut = found[min(wanted, len(found) - 1)]
    old = {shape_digest(fragment) for fragment in before}
    return Inference(
        now=before,
        goal=story.goal,
        log_current=_log_types(model, before),
        log_goal=_log_types(model, story.goal),
        cut=cut,
        why=why,
        products=tuple(fragment for fragment in after_cut if shape_digest(fragment) not in old),
        grammar=model.grammar,
        typical=typical,
    )


def _log_types(model: Model, fragments: Configuration) -> Floats:
    return model.classifier.log_probabilities(np.array([model.features(fragment.shape) for fragment in fragments]))
