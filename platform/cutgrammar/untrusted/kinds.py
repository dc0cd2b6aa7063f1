"""The kinds of values in files of strangers, each with its bounds; schemas are made of them."""

from typing import Annotated, Any

from pydantic import ConfigDict, Field, JsonValue

STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
"""No value is converted, and unknown names are refused."""
OPEN = ConfigDict(strict=True, extra="allow", allow_inf_nan=False)
"""The same, but unknown names are left to whoever reads the value."""

Small = Annotated[int, Field(ge=0, le=2**31 - 1)]
"""A number of something, or its place in a list."""
Seed = Annotated[int, Field(ge=0, le=2**63 - 1)]
Number = Annotated[float, Field(ge=-1e12, le=1e12)]
Seconds = Annotated[float, Field(ge=0, le=1e10)]
Share = Annotated[float, Field(ge=0, le=1)]
Word = Annotated[str, Field(pattern=r"^\w[\w .+@-]*$", max_length=100)]
"""A name: of a setup, method, food, ...; it can be part of a file's name."""
FoodName = Annotated[str, Field(pattern=r"^[^/\\\x00-\x1f\x7f-\x9f]+$", max_length=200)]
"""The name of a food, which may be that of a file."""
Identifier = Annotated[str, Field(pattern=r"^[^\W\d]\w*$", max_length=100)]
Digest = Annotated[str, Field(pattern=r"^[0-9a-z]{1,64}$")]
"""A sha256, whole or its beginning."""
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Version = Annotated[str, Field(pattern=r"^[\w.+!-]{1,64}$")]
Place = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f]+$", max_length=4096)]
"""A path."""
Line = Annotated[str, Field(max_length=10_000)]
"""Text for people; printed with control characters escaped."""
Text = Annotated[str, Field(max_length=1_000_000)]
Facts = Annotated[dict[Annotated[str, Field(max_length=200)], JsonValue], Field(max_length=1_000)]
"""Plain data that are only shown or compared."""


def fixed(kind: Any, length: int) -> Any:
    """A list of `length` values of a kind."""
    return Annotated[list[kind], Field(min_length=length, max_length=length)]
