"""The edge at which actions of a method enter the platform: what a plugin does there ends its own trials only."""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.geometry.plane import Plane
from cutgrammar.interfaces import Cut, Explanation, Planner, Refusal, Stuck
from cutgrammar_workers.tasks import printable

MAX_POINTS = 10_000
"""A cut names at most so many fragments."""


class MethodError(RuntimeError):
    """A method did what it may not do."""


class CheckedPlanner:
    """A planner whose actions are checked and made of plain values.

    Args:
        make_planner: makes the planner.
        is_plugin: whether the method comes from another package, whose `InputError` says nothing about this run.

    Raises:
        MethodError: a plugin raised `InputError`, or left by `SystemExit`.
    """

    def __init__(self, make_planner: Callable[[], Planner], is_plugin: bool) -> None:
        self._is_plugin = is_plugin
        with self._contained():
            self._planner = make_planner()

    def next_cut(
        self, now: Configuration, goal: Configuration, refused: Sequence[Refusal], rng: np.random.Generator
    ) -> Cut | Stuck:
        """See `Planner.next_cut`.

        Raises:
            MethodError: the action is no cut that a world could make, or as for the constructor.
        """
        with self._contained():
            return checked_action(self._planner.next_cut(now, goal, refused, rng))

    @contextmanager
    def _contained(self) -> Iterator[None]:
        process = os.getpid()
        try:
            yield
        except SystemExit as error:
            raise MethodError(f"the method left by SystemExit: {error}") from error
        except InputError as error:
            if self._is_plugin:
                raise MethodError(f"the method raised InputError: {error}") from error
            raise
        finally:
            if os.getpid() != process:  # a child that the method forked must not carry out the trial a second time
                os._exit(1)


def checked_action(action: object) -> Cut | Stuck:
    """A method's action, with arrays of float64 and text that can be stored.

    Raises:
        MethodError: it is neither a `Cut` nor a `Stuck`, or its contents are not what these hold.
    """
    if isinstance(action, Stuck):
        return Stuck(printable(_text(action.reason)))
    if not isinstance(action, Cut):
        raise MethodError(f"the method returned a {type(action).__name__}; a Cut or a Stuck is expected")
    if not isinstance(action.plane_W, Plane):
        raise MethodError(f"the plane of the method's cut is a {type(action.plane_W).__name__}; a Plane is expected")
    try:
        p_WC = np.asarray(action.p_WC, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise MethodError(f"the centroids of the method's cut are no numbers: {error}") from error
    if p_WC.ndim != 2 or p_WC.shape[1] != 3 or not 1 <= len(p_WC) <= MAX_POINTS or not np.isfinite(p_WC).all():
        raise MethodError(
            f"the centroids of the method's cut have shape {p_WC.shape}; (k, 3) is expected, with k of 1 to "
            f"{MAX_POINTS} and finite values"
        )
    why = action.explanation
    if why is not None:
        if not isinstance(why, Explanation):
            raise MethodError(f"the method explains its cut by a {type(why).__name__}; an Explanation is expected")
        production = printable(_text(why.production))
        why = why if production == why.production else replace(why, production=production)
    if p_WC is action.p_WC and why is action.explanation:
        return action
    return Cut(action.plane_W, p_WC, why)


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise MethodError(f"the method gave a {type(value).__name__} where text is expected")
    return value
