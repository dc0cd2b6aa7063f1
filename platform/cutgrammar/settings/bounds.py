"""The kinds of values that settings take, each with its bounds; pydantic checks them wherever a class is built."""

from typing import Annotated

from pydantic import ConfigDict, Field

CHECKED = ConfigDict(extra="forbid", allow_inf_nan=False, defer_build=True)
"""Unknown names, and numbers that are not finite, are refused; the checks are prepared when first needed."""

MOST = 100_000_000
"""Largest number of anything: no step, sample or file comes near, and none takes all memory."""
LARGEST = 1e9
"""Largest number that is not a count."""

Flag = Annotated[bool, Field(strict=True)]
Text = Annotated[str, Field(strict=True, max_length=4_000_000)]
Natural = Annotated[int, Field(strict=True, ge=0, le=MOST)]
Count = Annotated[int, Field(strict=True, ge=1, le=MOST)]
Few = Annotated[int, Field(strict=True, ge=1, le=1_000)]
"""A number of things that are all made, or kept, at once."""
Width = Annotated[int, Field(strict=True, ge=1, le=8_192)]
"""The width of a network's layer, or of an image."""
PointCount = Annotated[int, Field(strict=True, ge=32, le=1_000_000)]
NonNegative = Annotated[float, Field(strict=True, ge=0, le=LARGEST)]
Positive = Annotated[float, Field(strict=True, gt=0, le=LARGEST)]
Share = Annotated[float, Field(strict=True, ge=0, le=1)]
Names = Annotated[tuple[Text, ...], Field(min_length=1)]
"""`strict` keeps "7", 7.0 and true from passing as 7; a whole number passes as a float."""
