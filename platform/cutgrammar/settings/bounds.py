"""The kinds of values that settings take, each with its bounds; pydantic checks them wherever a class is built."""

from typing import Annotated

from pydantic import ConfigDict, Field

CHECKED = ConfigDict(extra="forbid", allow_inf_nan=False, defer_build=True)
"""Unknown names, and numbers that are not finite, are refused; the checks are prepared when first needed."""

Flag = Annotated[bool, Field(strict=True)]
Text = Annotated[str, Field(strict=True)]
Natural = Annotated[int, Field(strict=True, ge=0)]
Count = Annotated[int, Field(strict=True, ge=1)]
PointCount = Annotated[int, Field(strict=True, ge=32)]
NonNegative = Annotated[float, Field(strict=True, ge=0)]
Positive = Annotated[float, Field(strict=True, gt=0)]
Share = Annotated[float, Field(strict=True, ge=0, le=1)]
Names = Annotated[tuple[Text, ...], Field(min_length=1)]
"""`strict` keeps "7", 7.0 and true from passing as 7; a whole number passes as a float."""
