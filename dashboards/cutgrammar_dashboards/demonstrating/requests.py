"""What the demonstration page sends; numbers out of bounds are refused before anything looks at them."""

from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from cutgrammar.demonstration import HandStroke

Coordinate = Annotated[float, Field(ge=-100.0, le=100.0, allow_inf_nan=False)]
Vector = Annotated[list[Coordinate], Field(min_length=3, max_length=3)]
Seconds = Annotated[float, Field(ge=0.0, le=1e7, allow_inf_nan=False)]
CODE = r"^[A-Za-z0-9_\-]{1,32}$"
"""A participant's code: letters, digits, hyphens and underscores."""


class Message(BaseModel):
    """What all messages share: unknown fields are refused.

    Attributes:
        robot: whether the browser is driven by a program, or an event was not made by a person.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    robot: bool


class Join(Message):
    """Someone enters their code."""

    code: Annotated[str, Field(pattern=CODE)]


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

    def stroke(self) -> HandStroke:
        """The stroke, with directions of unit length.

        Raises:
            ValueError: a direction is zero.
        """
        first, second = (np.array(direction) for direction in (self.first, self.second))
        lengths = np.linalg.norm(first), np.linalg.norm(second)
        if min(lengths) < 1e-9:
            raise ValueError("a direction must not be zero")
        return HandStroke(
            step=0,
            p_WE=np.array(self.eye),
            first_W=first / lengths[0],
            second_W=second / lengths[1],
            explode=self.explode,
            first_seconds=self.first_seconds,
            second_seconds=self.second_seconds,
            cut_seconds=self.seconds,
        )
