"""What the demonstration page sends; numbers out of bounds are refused before anything looks at them."""

from typing import Annotated

import numpy as np
from pydantic import Field, field_validator

from cutgrammar.demonstration import HandStroke
from cutgrammar_dashboards.pages.messages import Message, Seconds

Coordinate = Annotated[float, Field(ge=-100.0, le=100.0, allow_inf_nan=False)]
Vector = Annotated[list[Coordinate], Field(min_length=3, max_length=3)]


class Action(Message):
    """An action, after the participant has seen `after` of them, at a time since the task was shown first [s]."""

    after: Annotated[int, Field(ge=0, le=1_000_000)]
    seconds: Seconds


class Stroke(Action):
    """Two clicks on a view; see `HandStroke`."""

    eye: Vector
    first: Vector
    second: Vector
    explode: Annotated[float, Field(ge=0.0, le=1.0)]
    first_seconds: Seconds
    second_seconds: Seconds

    @field_validator("first", "second")
    @classmethod
    def _not_zero(cls, direction: list[float]) -> list[float]:
        if np.linalg.norm(direction) < 1e-9:
            raise ValueError("a direction must not be zero")
        return direction

    def stroke(self) -> HandStroke:
        """The stroke, with directions of unit length."""
        first, second = (np.array(direction) for direction in (self.first, self.second))
        return HandStroke(
            step=0,
            p_WE=np.array(self.eye),
            first_W=first / np.linalg.norm(first),
            second_W=second / np.linalg.norm(second),
            explode=self.explode,
            first_seconds=self.first_seconds,
            second_seconds=self.second_seconds,
            cut_seconds=self.seconds,
        )
