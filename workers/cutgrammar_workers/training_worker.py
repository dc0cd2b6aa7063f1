"""The worker of repeated trainings: one call learns one model."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from cutgrammar.demonstration import Demonstration
from cutgrammar.learning.learn import Learned, Watch, learn
from cutgrammar.learning.model import Provenance
from cutgrammar.perception.vision.fused_cloud import LabelledCloud
from cutgrammar.settings import Settings


@dataclass(frozen=True, eq=False)
class TrainingContext:
    """The data that repetitions of one training share.

    Attributes:
        demonstrations: those of the training trials.
        settings: all settings.
        vision: whether the segmentation is learned too.
        watch: is called with the progress of each stage, where the worker is in the process of the caller.
    """

    demonstrations: Sequence[Demonstration]
    settings: Settings
    vision: bool
    watch: Watch | None = None


class TrainingWorker:
    """Learns models that differ in their provenance, hence in the seed."""

    def __init__(self, shared: TrainingContext) -> None:
        self._shared = shared

    def __call__(self, provenance: Provenance) -> Learned:
        """The model with this provenance, and how its parts were trained."""
        shared = self._shared
        scenes = _scenes if shared.vision else None
        return learn(shared.demonstrations, shared.settings, provenance, shared.watch, scenes)


def _scenes(
    demonstrations: Sequence[Demonstration], settings: Settings, seed: int, on_scene: Callable[[int], Any]
) -> list[LabelledCloud]:
    from cutgrammar_sim.worlds.scenes import seen_scenes  # simulator and cameras are needed only here

    return seen_scenes(demonstrations, settings, seed, settings.vision.n_scenes, on_scene)
