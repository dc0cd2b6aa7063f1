"""A model whose networks have random weights: it plans, if badly, and takes no time to train."""

from itertools import pairwise

import numpy as np

from cutgrammar.cutting.goal_planes import GoalPlaneNetwork
from cutgrammar.cutting.planes import PlaneNetwork
from cutgrammar.grammar.production import Grammar, Production
from cutgrammar.grammar.type_statistics import TypeStatistics
from cutgrammar.learning.model import Model, Provenance
from cutgrammar.nn.mixture import numbers_of
from cutgrammar.nn.mlp import MLP
from cutgrammar.nn.set_network import SetNetwork
from cutgrammar.perception.classifier import TypeClassifier
from cutgrammar.perception.encoder import Encoder
from cutgrammar.perception.feature import FeatureExtractor
from cutgrammar.settings import Settings


def untrained(data, split, seed=0):
    """A model whose networks have random weights; it plans, if badly."""
    rng = np.random.default_rng(seed)

    def network(*sizes):
        shapes = list(pairwise(sizes))
        return MLP(tuple(rng.normal(size=s) / np.sqrt(s[0]) for s in shapes), tuple(np.zeros(n) for _, n in shapes))

    return Model(
        Settings(),
        FeatureExtractor(Encoder(network(6, 8), network(8, 16)), 64),
        TypeClassifier(2, network(17, 8, 2), (0, 1), 1.0),
        Grammar(
            2,
            {Production(0, (0, 0)): 0.5, Production(0, (0, 1)): 0.5, Production(1, (1, 1)): 1.0},
            (0.5, 0.5),
        ),
        PlaneNetwork(2, 3, 0.02, network(2 * 2 + 17, 8, numbers_of(3, 4))),
        *(SetNetwork(network(17, 8, 4), network(17 + 2 * 4, 8, 1)) for _ in range(2)),
        GoalPlaneNetwork(3, 0.02, SetNetwork(network(17, 8, 4), network(17 + 4, 8, numbers_of(3, 4)))),
        Provenance(data.digest, split.name, split.digest, split.train, seed),
        induction={
            "type_means": rng.normal(size=(2, 17)).tolist(),
            "type_statistics": TypeStatistics(
                np.array([-9.0, -11.0]), np.ones(2), np.full((2, 3), -4.0), np.ones(2), np.array([0.1, 0.9])
            ).to_json(),
        },
    )
