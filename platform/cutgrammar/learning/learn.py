"""From demonstrations to a model: encoder, grammar, classifier, cutting planes, baselines (II-B, III-C, III-D, IV-B1).

Everything is fitted on the demonstrations given and on nothing else. Fragments that only an undone cut made, and undone
cuts, count for nothing. The cutting planes are learned under all four flips of the canonical frame, whose signs are
noise for many fragments; the classifier is fitted on the features that were clustered, as the paper says. What is held
out is held out by trial.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutgrammar.demonstration import DemonstratedCut, Demonstration
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.grammar.corpus import Corpus
from cutgrammar.grammar.induction import Induction, induce
from cutgrammar.grammar.type_means import type_means
from cutgrammar.learning.baselines import Baselines, learn_baselines
from cutgrammar.learning.classifier_training import Validation, cross_validate, fit_classifier
from cutgrammar.learning.encoder_training import fit_features
from cutgrammar.learning.model import Model, Provenance
from cutgrammar.learning.plane_training import DemonstratedPlane, PlaneValidation, cross_validate_planes, fit_planes
from cutgrammar.learning.segmentation_training import SegmentationTraining, fit_segmentation
from cutgrammar.learning.steps import steps_of
from cutgrammar.perception.vision.fused_cloud import LabelledCloud
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings

Watch = Callable[[str, int, int], Any]
"""Told the name of a stage, how much of it is done, and of how much."""
Scenes = Callable[[Sequence[Demonstration], Settings, int, Callable[[int], Any]], Sequence[LabelledCloud]]
"""Simulates scenes of demonstrations' objects: demonstrations, settings, seed and who is told how many there are."""


@dataclass(frozen=True, eq=False)
class Learned:
    """A model and how its parts came about.

    Attributes:
        model: the model.
        encoder_losses: mean binary cross entropy of every epoch [nats].
        induction: the grammar among others.
        classifier: held-out curve, temperature and accuracy of p(c|z).
        planes: held-out curve of the mixture density network.
        baselines: what `bc` and `qnet` use, with its held-out curves.
        segmentation: its losses; None where it was not trained.
    """

    model: Model
    encoder_losses: tuple[float, ...]
    induction: Induction
    classifier: Validation
    planes: PlaneValidation
    baselines: Baselines
    segmentation: SegmentationTraining | None = None


@dataclass(frozen=True, eq=False)
class TrainingFragments:
    """What the demonstrations hold, their fragments numbered through.

    Attributes:
        meshes: of every fragment.
        trials: (n,) the trial each comes from.
        cuts: (fragment cut, fragments it became, the cut) of every cut that was kept.
    """

    meshes: tuple[Mesh, ...]
    trials: tuple[int, ...]
    cuts: tuple[tuple[int, tuple[int, ...], DemonstratedCut], ...]


def learn(
    demonstrations: Sequence[Demonstration],
    settings: Settings,
    provenance: Provenance,
    watch: Watch | None = None,
    scenes: Scenes | None = None,
) -> Learned:
    """Learn a model; the same arguments give the same bits.

    Args:
        demonstrations: of the training trials, no others.
        settings: of features, induction, classifier, planes and baselines; the rest of them plays no part.
        provenance: where the demonstrations come from, with the seed of the training.
        watch: told how far it is.
        scenes: simulates what the segmentation is trained on; None: it is not trained.

    Raises:
        ValueError: the demonstrations hold no cut that was kept.
    """
    watch = watch or _unwatched
    seed, used = provenance.seed, settings_used(settings, scenes is not None)
    fragments = training_fragments(demonstrations)
    if not fragments.cuts:
        raise ValueError("the training trials hold no cut, so there is nothing to learn from")
    epochs = used.features.epochs
    features, encoder = fit_features(
        fragments.meshes, used.features, stream(seed, "encoder"), lambda epoch, _: watch("encoder", epoch, epochs)
    )
    z = np.array([features.flipped(mesh) for mesh in fragments.meshes])
    trials = np.array(fragments.trials)
    corpus = Corpus(z[:, 0], trials, tuple((cut, made) for cut, made, _ in fragments.cuts))
    induction = induce(
        corpus, used.induction, stream(seed, "induction"), lambda done, total: watch("induction", done, total)
    )
    k, types = induction.k, induction.types
    typing = cross_validate(z[:, 0], types, k, used.classifier, seed, trials)
    watch("classifier", 1, 2)
    classifier = fit_classifier(z[:, 0], types, k, used.classifier, seed, trials, typing)
    watch("classifier", 2, 2)
    cuts = [
        DemonstratedPlane(production, z[cut], made.plane_C, int(trials[cut]))
        for production, (cut, _, made) in zip(corpus.productions(types), fragments.cuts, strict=True)
    ]
    cutting = cross_validate_planes(cuts, k, used.planes, seed)
    watch("planes", 1, 2)
    planes = fit_planes(cuts, k, used.planes, seed, cutting)
    watch("planes", 2, 2)
    baselines = learn_baselines(steps_of(z, fragments.trials, fragments.cuts), used, seed, watch)
    segmentation, seeing = None, None
    if scenes is not None:
        number, vision = used.vision.n_scenes, used.vision
        clouds = scenes(demonstrations, used, seed, lambda made: watch("scenes", made, number))
        segmentation, seeing = fit_segmentation(
            clouds,
            vision,
            stream(seed, "segmentation"),
            lambda epoch, _: watch("segmentation", epoch, vision.epochs),
        )
    measured = {
        "fragments": len(z),
        "cuts": len(cuts),
        "encoder_loss": encoder.losses[-1] if encoder.losses else None,
        "k": k,
        "gamma": induction.gamma,
        "productions": len(induction.grammar.probabilities),
        "classifier_epochs": typing.epochs,
        "classifier_temperature": typing.temperature,
        "classifier_held_out_accuracy": typing.accuracy,
        "classifier_held_out_log_likelihood": typing.log_likelihood,
        "planes_epochs": cutting.epochs,
        "planes_held_out_loss": cutting.loss,
        "planes_held_out_loss_of_one_gaussian": cutting.gaussian_loss,
        **baselines.measured,
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
            }
        ),
        metrics={name: float(value) for name, value in measured.items() if value is not None},
    )
    return Learned(model, encoder.losses, induction, typing, cutting, baselines, seeing)


def settings_used(settings: Settings, vision: bool = False) -> Settings:
    """`settings` with what learning does not read at its defaults, so that it does not tell models apart.

    Args:
        settings: all of them.
        vision: the segmentation is learned too, which reads those of the scenes it is trained on.
    """
    seeing = Settings()
    if vision:
        seen = dataclasses.replace(settings.vision, belief=seeing.vision.belief)
        seeing = Settings(world=settings.world, cameras=settings.cameras, vision=seen)
    return dataclasses.replace(
        seeing,
        features=settings.features,
        induction=settings.induction,
        classifier=settings.classifier,
        planes=settings.planes,
        baselines=settings.baselines,
    )


def training_fragments(demonstrations: Sequence[Demonstration]) -> TrainingFragments:
    """The fragments and cuts of `demonstrations` that were kept."""
    meshes: list[Mesh] = []
    trials: list[int] = []
    cuts: list[tuple[int, tuple[int, ...], DemonstratedCut]] = []
    for demonstration in demonstrations:
        kept = [cut for cut in demonstration.cuts if not cut.undone]
        there = set(demonstration.alive(0)).union(*(cut.products for cut in kept))
        number = {fragment: len(meshes) + i for i, fragment in enumerate(sorted(there))}
        meshes += [demonstration.fragments[fragment].mesh for fragment in sorted(there)]
        trials += [demonstration.trial] * len(there)
        cuts += [(number[cut.fragment], tuple(number[made] for made in cut.products), cut) for cut in kept]
    return TrainingFragments(tuple(meshes), tuple(trials), tuple(cuts))


def _unwatched(stage: str, done: int, total: int) -> None:
    """Nobody looks."""


def _plain(value: Any) -> Any:
    """`value` as JSON can hold it; a number that is not finite becomes None."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _plain(dataclasses.asdict(value))
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
