"""Training the segmentation on simulated scenes (IV-D), with torch.

The loss is the binary cross entropy of whether both ends of an edge belong to one fragment; the few edges across a seam
weigh more. One patch of every scene is used: the points nearest to a point drawn at random. Held-out scenes choose the
threshold of the grouping.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from scipy.spatial import cKDTree

from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.nn.mlp import deviation_of, with_standardised_inputs
from cutgrammar.nn.mlp_training import Layers, deterministic, forward, initialise, parameters_of, to_mlp
from cutgrammar.perception.vision.fused_cloud import LabelledCloud
from cutgrammar.perception.vision.neighbourhoods import EDGE_FEATURES, MAX_EDGE_LENGTH, POINT_FEATURES, describe, thin
from cutgrammar.perception.vision.segment_iou import per_fragment_iou
from cutgrammar.perception.vision.segmentation import Segmentation, grouped
from cutgrammar.settings import VisionSettings

PATCH = 3000
"""Number of thinned points of a scene that are trained on."""
SEAM_WEIGHT = 3.0
"""Additional weight of an edge across a seam; other edges weigh 1."""
HELD_OUT_SHARE = 0.06
"""Share of the scenes that are held out to choose the threshold."""
THRESHOLDS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
WEIGHT_DECAY = 1e-3


@dataclass(frozen=True, eq=False)
class SegmentationTraining:
    """The result of training.

    Attributes:
        losses: mean loss of every epoch [nats].
        held_out_losses: the same on the held-out scenes; empty where there are none.
        held_out_iou: mean over the held-out scenes of the sum of the fragments' IoU, divided by the number of fragments
            or of clusters, whichever is larger, with the chosen threshold; None where there are no such scenes.
    """

    losses: tuple[float, ...]
    held_out_losses: tuple[float, ...]
    held_out_iou: float | None


@dataclass(frozen=True, eq=False)
class _Patch:
    """Part of a scene as tensors; edges are kept in half precision."""

    points: torch.Tensor
    near: torch.Tensor
    near_edges: torch.Tensor
    far: torch.Tensor
    far_edges: torch.Tensor
    same: torch.Tensor
    weight: torch.Tensor


@dataclass(frozen=True, eq=False)
class _Network:
    """The segmentation in training."""

    describing: Layers
    rounds: list[tuple[Layers, Layers]]
    judging: Layers

    @property
    def layers(self) -> Layers:
        return [*self.describing, *(pair for both in self.rounds for part in both for pair in part), *self.judging]

    def __call__(self, patch: _Patch) -> torch.Tensor:
        """(m, k) log odds that a point and each near point belong to one fragment (see `Segmentation.together`)."""
        h = torch.relu(forward(self.describing, patch.points))
        for number, (message, update) in enumerate(self.rounds):
            others, edges = (patch.near, patch.near_edges) if number % 2 else (patch.far, patch.far_edges)
            rows = torch.cat([h[:, None].expand(-1, others.shape[1], -1), _at(h, others), edges.float()], dim=2)
            messages = torch.relu(forward(message, rows))
            h = h + forward(update, torch.cat([h, messages.mean(dim=1), messages.amax(dim=1)], dim=1))
        own, other = h[:, None], _at(h, patch.near)
        rows = torch.cat([own + other, (own - other).abs(), patch.near_edges.float()], dim=2)
        return forward(self.judging, rows)[..., 0]


def fit_segmentation(
    scenes: Sequence[LabelledCloud],
    settings: VisionSettings,
    rng: np.random.Generator,
    on_epoch: Callable[[int, float], Any] | None = None,
) -> tuple[Segmentation, SegmentationTraining]:
    """Train the segmentation; the same arguments give the same bits.

    Args:
        scenes: simulated scenes of training foods.
        settings: sizes and length of the training.
        rng: draws patches, initial weights and the order of scenes.
        on_epoch: called with the number of every finished epoch, from 1, and its loss.

    Raises:
        ValueError: no scenes, or none in which a point belongs to a fragment.
    """
    patches = [_patch(scene, rng) for scene in scenes]
    held_out = int(HELD_OUT_SHARE * len(scenes))
    training = [patch for patch in patches[held_out:] if patch is not None]
    validation = [patch for patch in patches[:held_out] if patch is not None]
    if not training:
        raise ValueError("a segmentation needs at least one scene with a fragment in it")
    rows = torch.cat([patch.points for patch in training]).double().numpy()
    mean, deviation = rows.mean(axis=0), deviation_of(rows)
    training, validation = ([_standardised(p, mean, deviation) for p in part] for part in (training, validation))
    losses, held_out_losses = [], []
    with deterministic():
        network = _initial(settings.hidden_size, settings.n_message_rounds, rng)
        parameters = parameters_of(network.layers)
        optimiser = torch.optim.AdamW(parameters, lr=settings.learning_rate, weight_decay=WEIGHT_DECAY)
        steps = settings.epochs * len(training)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, settings.learning_rate, total_steps=steps + 1)
        for epoch in range(settings.epochs):
            total = 0.0
            for i in rng.permutation(len(training)):
                loss = _loss(network, training[i])
                optimiser.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                optimiser.step()
                schedule.step()
                total += float(loss.detach())
            losses.append(total / len(training))
            if validation:
                with torch.no_grad():
                    held_out_losses.append(float(np.mean([float(_loss(network, patch)) for patch in validation])))
            if on_epoch is not None:
                on_epoch(epoch + 1, losses[-1])
    finished = _finished(network, mean, deviation, settings.merge_threshold)
    threshold, iou = _best_threshold(finished, scenes[:held_out])
    finished = _finished(network, mean, deviation, threshold)
    return finished, SegmentationTraining(tuple(losses), tuple(held_out_losses), iou)


def _patch(scene: LabelledCloud, rng: np.random.Generator) -> _Patch | None:
    """The points of a scene nearest to a point drawn at random; None where the scene is empty."""
    draw = rng.random()
    if len(scene.points) < 2:
        return None
    thinned = thin(scene.points, scene.normals)
    seen = describe(thinned.points, thinned.normals)
    owners = _majority_owner(thinned.cell_of, scene.owners, len(thinned.points))
    middle = thinned.points[int(draw * len(thinned.points))]
    some = np.sort(cKDTree(thinned.points).query(middle, k=min(PATCH, len(thinned.points)))[1].ravel())
    number = np.full(len(thinned.points), -1)
    number[some] = np.arange(len(some))

    def within(others: Ints) -> torch.Tensor:
        """Indices within the patch; a neighbour outside is replaced by the point itself."""
        inside = number[others[some]]
        return torch.from_numpy(np.where(inside >= 0, inside, np.arange(len(some))[:, None]))

    near = owners[seen.near[some]]
    own = owners[some][:, None]
    used = (seen.lengths[some] <= MAX_EDGE_LENGTH) & (own >= 0) & (near >= 0) & (number[seen.near[some]] >= 0)
    same = own == near
    return _Patch(
        torch.from_numpy(seen.points[some].astype(np.float32)),
        within(seen.near),
        torch.from_numpy(seen.near_edges[some].astype(np.float16)),
        within(seen.far),
        torch.from_numpy(seen.far_edges[some].astype(np.float16)),
        torch.from_numpy(same.astype(np.float32)),
        torch.from_numpy((used * np.where(same, 1.0, 1.0 + SEAM_WEIGHT)).astype(np.float32)),
    )


def _majority_owner(cell_of: Ints, owners: Ints, cells: int) -> Ints:
    """(m,) the owner of most points of each cell."""
    n_owners = int(owners.max(initial=0)) + 2
    votes = np.bincount(cell_of * n_owners + np.maximum(owners, -1) + 1, minlength=cells * n_owners)
    return np.asarray(votes.reshape(cells, n_owners).argmax(axis=1) - 1)


def _standardised(patch: _Patch, mean: Floats, deviation: Floats) -> _Patch:
    points = ((patch.points.double() - torch.from_numpy(mean)) / torch.from_numpy(deviation)).float()
    return _Patch(points, patch.near, patch.near_edges, patch.far, patch.far_edges, patch.same, patch.weight)


def _initial(hidden: int, message_rounds: int, rng: np.random.Generator) -> _Network:
    describing = initialise((POINT_FEATURES, hidden, hidden), rng)
    rounds = [
        (
            initialise((2 * hidden + EDGE_FEATURES, hidden), rng),
            initialise((3 * hidden, hidden, hidden), rng),
        )
        for _ in range(message_rounds)
    ]
    judging = initialise((2 * hidden + EDGE_FEATURES, hidden, 1), rng)
    return _Network(describing, rounds, judging)


def _loss(network: _Network, patch: _Patch) -> torch.Tensor:
    each = torch.nn.functional.binary_cross_entropy_with_logits(network(patch), patch.same, reduction="none")
    return (each * patch.weight).sum() / patch.weight.sum().clamp(min=1.0)


def _finished(network: _Network, mean: Floats, deviation: Floats, threshold: float) -> Segmentation:
    return Segmentation(
        with_standardised_inputs(to_mlp(network.describing), mean, deviation),
        tuple((to_mlp(message), to_mlp(update)) for message, update in network.rounds),
        to_mlp(network.judging),
        threshold,
    )


def _best_threshold(segmentation: Segmentation, scenes: Sequence[LabelledCloud]) -> tuple[float, float | None]:
    """The threshold with the highest `held_out_iou` in `scenes`, and that IoU; the present one without scenes."""
    scenes = [scene for scene in scenes if (scene.owners >= 0).any()]
    if not scenes:
        return segmentation.threshold, None
    ious = np.empty((len(scenes), len(THRESHOLDS)))
    for i, scene in enumerate(scenes):
        thinned = thin(scene.points, scene.normals)
        edges, p = segmentation.edge_probabilities(describe(thinned.points, thinned.normals))
        for j, threshold in enumerate(THRESHOLDS):
            labels = grouped(thinned, edges, p, threshold)
            each = per_fragment_iou(scene.owners, labels)
            ious[i, j] = each.sum() / max(len(each), int(labels.max()) + 1)  # small extra clusters lower it
    best = int(np.argmax(ious.mean(axis=0)))
    return THRESHOLDS[best], float(ious[:, best].mean())


def _at(h: torch.Tensor, others: torch.Tensor) -> torch.Tensor:
    """(m, k, size) rows of h (m, size) at indices (m, k)."""
    return h.index_select(0, others.reshape(-1)).reshape(*others.shape, -1)
