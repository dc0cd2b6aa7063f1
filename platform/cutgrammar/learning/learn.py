"""From demonstrations to a model: encoder, grammar, classifier, cutting planes, baselines (II-B, III-C, III-D, IV-B1).

Everything is fitted on the given demonstrations only. Undone cuts, and fragments that only they made, are left out. The
cutting planes are learned under all four flips of the canonical frame, whose signs are noise for many fragments; the
classifier is fitted on the features that were clustered, as in the paper. Cross-validation holds out whole trials.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from cutgrammar.demonstration import Demonstration
from cutgrammar.grammar.corpus import Corpus
from cutgrammar.grammar.induction import Induction, induce
from cutgrammar.grammar.type_means import type_means
from cutgrammar.grammar.type_statistics import type_statistics
from cutgrammar.learning.baselines import Baselines, learn_baselines
from cutgrammar.learning.classifier_training import Validation, fit_classifier
from cutgrammar.learning.encoder_training import fit_features
from cutgrammar.learning.model import Model, Provenance
from cutgrammar.learning.plane_training import DemonstratedPlane, fit_planes
from cutgrammar.learning.plane_validation import PlaneValidation
from cutgrammar.learning.segmentation_training import SegmentationTraining, fit_segmentation
from cutgrammar.learning.settings_used import settings_used
from cutgrammar.learning.steps import steps_of
from cutgrammar.learning.training_fragments import training_fragments
from cutgrammar.perception.vision.fused_cloud import LabelledCloud
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings

Watch = Callable[..., Any]
"""Called with the name of a stage, how much of it is done, and of how much, and perhaps with the points ((x, y), ...)
that were measured since: the loss of an epoch, the losses of all epochs of a fold, or the objective of a number of
types."""
Scenes = Callable[[Sequence[Demonstration], Settings, int, Callable[[int], Any]], Sequence[LabelledCloud]]
"""(demonstrations, settings, seed, called with the number of scenes so far) -> simulated scenes of their objects."""


@dataclass(frozen=True, eq=False)
class Learned:
    """A model and how its parts were trained.

    Attributes:
        model: the model.
        encoder_losses: mean binary cross entropy of every epoch [nats].
        induction: the grammar and how it was chosen.
        classifier: held-out losses, temperature and accuracy of p(c|z).
        planes: held-out losses of the mixture density network.
        baselines: the networks of `bc` and `qnet`, with their held-out losses.
        segmentation: its losses; None where it was not trained.
    """

    model: Model
    encoder_losses: tuple[float, ...]
    induction: Induction
    classifier: Validation
    planes: PlaneValidation
    baselines: Baselines
    segmentation: SegmentationTraining | None = None


def learn(
    demonstrations: Sequence[Demonstration],
    settings: Settings,
    provenance: Provenance,
    watch: Watch | None = None,
    scenes: Scenes | None = None,
) -> Learned:
    """Learn a model; the same arguments give the same bits.

    Args:
        demonstrations: those of the training trials; they are gone through several times, one after another.
        settings: those of features, induction, classifier, planes and baselines are used, and with `scenes` those of
            vision.
        provenance: where the demonstrations come from, with the seed of the training.
        watch: is called with the progress of each stage.
        scenes: simulates the scenes that the segmentation is trained on; None: there is no segmentation.

    Raises:
        ValueError: the demonstrations hold no cut that was kept.
    """
    watch = watch or _ignore
    seed, used = provenance.seed, settings_used(settings, scenes is not None)
    fragments = training_fragments(demonstrations)
    if not fragments.cuts:
        raise ValueError("the training trials hold no cut, so there is nothing to learn from")
    features, encoder = fit_features(
        fragments.meshes,
        used.features,
        stream(seed, "encoder"),
        lambda epoch, loss: watch("encoder", epoch, used.features.epochs, ((epoch, loss),)),
    )
    flipped = []
    for mesh in fragments.meshes:
        flipped.append(features.flipped(mesh))
        watch("features", len(flipped), len(fragments.meshes))
    z = np.array(flipped)
    corpus = Corpus(z[:, 0], np.array(fragments.trials), tuple((cut, made) for cut, made, _ in fragments.cuts))
    induction = induce(corpus, used.induction, stream(seed, "induction"), partial(watch, "induction"))
    k, types = induction.k, induction.types
    classifier, typing = fit_classifier(
        corpus.features, types, k, used.classifier, seed, corpus.trials, partial(watch, "classifier")
    )
    made = {product for _, products, _ in fragments.cuts for product in products}
    cuts = [
        DemonstratedPlane(production, z[fragment], cut.plane_C, fragments.trials[fragment], fragment not in made)
        for production, (fragment, _, cut) in zip(corpus.productions(types), fragments.cuts, strict=True)
    ]
    planes, cutting = fit_planes(cuts, k, used.planes, seed, partial(watch, "planes"))
    baselines = learn_baselines(steps_of(z, fragments.trials, fragments.cuts), used, seed, watch)
    segmentation, seeing = None, None
    if scenes is not None:
        clouds = scenes(demonstrations, used, seed, lambda made: watch("scenes", made, used.vision.n_scenes))
        segmentation, seeing = fit_segmentation(
            clouds,
            used.vision,
            stream(seed, "segmentation"),
            lambda epoch, loss: watch("segmentation", epoch, used.vision.epochs, ((epoch, loss),)),
        )
    metrics = {
        "fragments": len(z),
        "cuts": len(cuts),
        "encoder_loss": encoder.losses[-1] if encoder.losses else None,
        "k": k,
        "gamma": induction.gamma,
        "productions": len(induction.grammar.probabilities),
        **typing.metrics,
        **cutting.metrics("planes"),
        **baselines.metrics,
        "segmentation_held_out_iou": None if seeing is None else seeing.held_out_iou,
        "segmentation_threshold": None if segmentation is None else segmentation.threshold,
    }
    model = Model(
        settings=used,
        features=features,
        classifier=classifier,
        grammar=induction.grammar,
        planes=planes,
        policy=baselines.policy,
        values=baselines.values,
        goal_planes=baselines.goal_planes,
        provenance=provenance,
        segmentation=segmentation,
        induction=_plain(
            {
                "gamma": induction.gamma,
                "gammas": list(induction.gammas),
                "curve": list(induction.curve),
                "type_means": type_means(z[:, 0], types, k).tolist(),
                "type_statistics": type_statistics(
                    fragments.meshes, types, [cut for cut, _, _ in fragments.cuts], k
                ).to_json(),
            }
        ),
        metrics={name: float(value) for name, value in metrics.items() if value is not None},
    )
    return Learned(model, encoder.losses, induction, typing, cutting, baselines, seeing)


def _ignore(*_: Any) -> None:
    """A `Watch` that does nothing."""


def _plain(value: Any) -> Any:
    """`value` as plain data for JSON; a number that is not finite becomes None."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _plain(dataclasses.asdict(value))
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
