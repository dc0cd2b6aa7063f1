"""Settings of what is learned: features, grammar, classifier, cutting planes, baselines and segmentation."""

from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from cutgrammar.settings.bounds import (
    CHECKED,
    Count,
    Few,
    Flag,
    Natural,
    NonNegative,
    PointCount,
    Positive,
    Share,
    Width,
)


@dataclass(frozen=True, config=CHECKED)
class FeatureSettings:
    """The point-cloud encoder and the shape feature z (III-D).

    Attributes:
        n_points: surface points per fragment.
        n_points_per_step: points of these that the encoder sees in each training step, drawn anew each time.
        shape_size: length of z_shape.
        hidden_size: width of the encoder's shared MLP and of the implicit decoder.
        max_fragments: most fragments that the encoder is trained on, drawn at random from all training fragments.
        epochs: passes over them.
        batch_size: fragments per training step.
        n_queries: inside/outside points per fragment and step.
        learning_rate: maximum learning rate of Adam; it rises and falls in one cycle.
    """

    n_points: PointCount = 1024
    n_points_per_step: Count = 64
    shape_size: Width = 16
    hidden_size: Width = 64
    max_fragments: Count = 2000
    epochs: Count = 200
    batch_size: Count = 8
    n_queries: Count = 128
    learning_rate: Positive = 6e-3


@dataclass(frozen=True, config=CHECKED)
class InductionSettings:
    """MAP induction of the grammar (Eq. 1-2).

    Attributes:
        max_k: largest number of fragment types tried; 0: as many as it takes for the objective to turn.
        fixed_k: number of fragment types to use instead of the optimum of Eq. (1); 0 uses the optimum.
        n_starts: random starts of the clustering for each k; the folds of the cross-validation have one.
        within_type_std: standard deviation of the features within a type, in units of their deviation among all
            fragments. The default is the deviation that the arbitrary signs of the canonical frame alone cause in the
            features of one fragment.
        gammas: candidates for the prior's coefficient per unit of model size; held-out likelihood chooses among them.
            The unit is that of the Bayesian information criterion: half the log of the number of fragments for each
            number that a type brings.
        model_size: what |G| counts: "types" or "types+productions".
        emission: whether the likelihood includes the features given their types; without them the best k is 1.
        n_folds: cross-validation folds of the training trials that choose gamma and give the curve.
        n_repeats: how often the cross-validation is repeated with other folds.
    """

    max_k: Natural = 0
    fixed_k: Natural = 0
    n_starts: Few = 4
    within_type_std: NonNegative = 0.17
    gammas: Annotated[
        tuple[Annotated[float, Field(strict=True, le=0, ge=-1e9)], ...], Field(min_length=1, max_length=100)
    ] = (-1.0,)
    model_size: Literal["types", "types+productions"] = "types"
    emission: Flag = True
    n_folds: Natural = 4
    n_repeats: Few = 1


@dataclass(frozen=True, config=CHECKED)
class ClassifierSettings:
    """The fragment-type classifier p(c|z).

    Attributes:
        hidden_size: width of its hidden layer.
        epochs: length of the training; every epoch is one step.
        batch_size: training fragments in a step, drawn anew each time; all where there are no more.
        learning_rate, weight_decay: of AdamW.
        jitter: standard deviation of the noise added to z in training, in units of the common deviation in which z is
            clustered.
        n_folds: cross-validation folds of the training trials, for calibration.
    """

    hidden_size: Width = 64
    epochs: Count = 400
    batch_size: Count = 2048
    learning_rate: Positive = 3e-3
    weight_decay: NonNegative = 1e-2
    jitter: NonNegative = 0.3
    n_folds: Natural = 4


@dataclass(frozen=True, config=CHECKED)
class PlaneSettings:
    """The mixture density network for cutting planes (III-C).

    Attributes:
        n_components: Gaussians in the mixture.
        hidden_size: width of the hidden layer.
        epochs: length of the training; every epoch is one step.
        batch_size: training cuts in a step, drawn anew each time; all where there are no more.
        learning_rate, weight_decay: of AdamW.
        min_sigma: lower bound of the standard deviations, in normalised units.
        jitter: standard deviation of the noise added to z in training, in units of its own deviation.
        n_folds: cross-validation folds of the training trials, which measure held-out quality.
    """

    n_components: Few = 16
    hidden_size: Width = 64
    epochs: Count = 600
    batch_size: Count = 512
    learning_rate: Positive = 2e-3
    weight_decay: NonNegative = 1e-2
    min_sigma: NonNegative = 0.02
    jitter: NonNegative = 1.5
    n_folds: Natural = 4


@dataclass(frozen=True, config=CHECKED)
class BaselineSettings:
    """The learned baselines `bc` and `qnet`, and the plane head they share (IV-B1).

    Attributes:
        embedding_size: length of the state embedding s.
        hidden_size: width of every hidden layer.
        epochs: length of the training; every epoch is one step.
        batch_size: training cuts in a step, drawn anew each time; all where there are no more.
        learning_rate, weight_decay: of AdamW.
        jitter: standard deviation of the noise added to z in training, in units of the common deviation of its numbers.
        plane_epochs, plane_jitter: the same for the plane head; its mixture is that of `PlaneSettings`.
        n_folds: cross-validation folds of the training trials, which measure held-out quality.
        discount: factor on the reward for reaching the goal, per cut before it.
        margin: by how much the value of the demonstrated fragment should exceed every other value.
        margin_weight: weight of the large-margin loss beside the temporal difference.
        target_update_epochs: epochs between two updates of the target network.
    """

    embedding_size: Width = 32
    hidden_size: Width = 64
    max_fragments: Count = 2000
    epochs: Count = 200
    batch_size: Count = 512
    learning_rate: Positive = 2e-3
    weight_decay: NonNegative = 1e-2
    jitter: NonNegative = 0.6
    plane_epochs: Count = 600
    plane_jitter: NonNegative = 1.0
    n_folds: Natural = 4
    discount: Share = 0.9
    margin: NonNegative = 0.2
    margin_weight: NonNegative = 1.0
    target_update_epochs: Count = 10


@dataclass(frozen=True, config=CHECKED)
class VisionSettings:
    """The segmentation of the fused cloud into fragments, and its training on simulated scenes.

    Attributes:
        n_scenes: simulated scenes for training.
        epochs: passes over them.
        learning_rate: maximum learning rate of AdamW.
        hidden_size: width of every hidden layer.
        n_message_rounds: rounds of message passing between neighbouring points.
        merge_threshold: two clusters are merged from this mean probability along their seam on; used where no scene is
            held out that could choose the threshold.
        belief: whether a new observation is combined with earlier ones and with the plane of the last cut, since no
            camera shows the seam of a cut. False segments every cloud by itself.
        seams: whether cuts that the robot did not make are searched as valleys in the cloud, in the first observation
            or, without belief, in every one. They are found from about 1.5 mm of gap on.
    """

    n_scenes: Count = 300
    epochs: Count = 8
    learning_rate: Positive = 4e-3
    hidden_size: Width = 24
    n_message_rounds: Few = 2
    merge_threshold: Annotated[float, Field(strict=True, ge=0.01, le=0.99)] = 0.5
    belief: Flag = True
    seams: Flag = True
