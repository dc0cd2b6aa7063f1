"""A pair of configurations as the browser shows it; nothing in it says which method reached it, or in which trial."""

import json
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from cutgrammar.geometry.fragment import Configuration, Fragment
from cutgrammar.geometry.pose import Pose
from cutgrammar.storage.configurations import TrialConfigurations
from cutgrammar.trials.rating_plan import OTHER, RESULT, Pair
from cutgrammar.trials.record import TrialKey
from cutgrammar_dashboards.pages.browser_meshes import browser_mesh

COLOUR = "#e3924a"
"""Of all fragments, skin and flesh: shapes are compared, and the score, too, matches fragments of any food."""
APART = 0.8
"""Share of a fragment's distance from the middle that moves it apart at most."""
CACHED = 64
"""Trials whose meshes are kept in memory."""

Read = Callable[[TrialKey], TrialConfigurations]


class ShownPairs:
    """Makes what the browser shows of pairs; several threads may use it."""

    def __init__(self, read: Read) -> None:
        """`read` gives the configurations of a trial."""
        self._meshes = lru_cache(CACHED)(lambda key: _meshes_of(read(key)))

    def sides(self, pair: Pair) -> tuple[bytes, bytes]:
        """The goal and the result of a pair, as JSON."""
        goal, reached = self._meshes(pair.key)
        if pair.kind == RESULT:
            return goal, reached
        if pair.kind == OTHER and pair.other is not None:
            return goal, self._meshes(pair.other)[0]
        return goal, goal


def _meshes_of(trial: TrialConfigurations) -> tuple[bytes, bytes]:
    return _side(trial.goal), _side(trial.reached)


def _side(configuration: Configuration) -> bytes:
    """A configuration as JSON: its fragments, and how far they move apart [m]."""
    fragments = _centred(configuration)
    centres = np.array([fragment.p_WC for fragment in fragments])
    shifts = APART * (centres - (centres.min(axis=0) + centres.max(axis=0)) / 2.0)
    shifts -= [0.0, 0.0, float(shifts[:, 2].min())]
    content = {
        "new": {i: _mesh(fragment) for i, fragment in enumerate(fragments)},
        "shifts": {i: shift.round(6).tolist() for i, shift in enumerate(shifts)},
    }
    return json.dumps(content, separators=(",", ":")).encode()


def _mesh(fragment: Fragment) -> dict[str, Any]:
    """The mesh in one colour, with its flat parts apart from the rest, so that their shading has no seams."""
    return browser_mesh(fragment, "", 0.0) | {"colours": [COLOUR, COLOUR]}


def _centred(configuration: Configuration) -> Configuration:
    """The configuration around the origin, on the board, so that one view shows goal and result alike."""
    points = np.concatenate([fragment.X_WF.apply(fragment.mesh.vertices) for fragment in configuration])
    low, high = points.min(axis=0), points.max(axis=0)
    away = np.array([*((low + high) / 2.0)[:2], low[2]])
    return tuple(Fragment(f.shape, Pose(f.X_WF.rotation, f.X_WF.position - away)) for f in configuration)
