"""What all pages send; numbers out of bounds and unknown fields are refused before anything looks at them."""

from typing import Annotated

from fastapi import Header
from pydantic import BaseModel, ConfigDict, Field

Seconds = Annotated[float, Field(ge=0.0, le=1e7, allow_inf_nan=False)]
CODE = r"^[A-Za-z0-9_\-]{1,32}$"
"""A participant's code: letters, digits, hyphens and underscores."""
Key = Annotated[str, Header(alias="X-Session", max_length=64)]
"""The header with the key that a participant was given."""


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
