"""What `manifest.json` of a data set may hold."""

from itertools import pairwise
from typing import Annotated

from pydantic import AfterValidator, Field, JsonValue, TypeAdapter, with_config
from typing_extensions import TypedDict

from cutgrammar.settings import DemonstratorSettings, validated
from cutgrammar.storage.tables import ALL_SCHEMAS, SCHEMAS
from cutgrammar.untrusted.kinds import STRICT, FoodName, Line, Seed, Sha256, Small, Version

MAX_PART = 10_000_000


def _all_tables(digests: dict[str, str]) -> dict[str, str]:
    if missing := [table for table in SCHEMAS if table not in digests]:
        raise ValueError(f"the table {missing[0]} is missing")
    if unknown := [table for table in digests if table not in ALL_SCHEMAS]:
        raise ValueError(f"there is no table {unknown[0][:40]!r}")
    return digests


def _ascending(trials: list[int]) -> list[int]:
    if any(a >= b for a, b in pairwise(trials)):
        raise ValueError("the trials are not ascending")
    return trials


def _apart(parts: "list[PartFacts]") -> "list[PartFacts]":
    """Parts with numbers and trials that ascend."""
    for part, other in pairwise(parts):
        if part["number"] >= other["number"]:
            raise ValueError(f"the number {other['number']} of a part is not above that before it")
        if part["trials"][-1] >= other["trials"][0]:
            raise ValueError(f"trial {other['trials'][0]} is not above those of the part before it")
    return parts


def _demonstrator(settings: dict[str, JsonValue]) -> dict[str, JsonValue]:
    validated(DemonstratorSettings, settings, "settings")
    return settings


Demonstrator = Annotated[dict[str, JsonValue], AfterValidator(_demonstrator)]
Foods = Annotated[dict[FoodName, Line], Field(max_length=1_000)]
"""Name of a food -> its source."""


@with_config(STRICT)
class PartFacts(TypedDict):
    """A part: see `manifest.Part`."""

    number: Annotated[int, Field(ge=0, le=MAX_PART)]
    trials: Annotated[list[Small], Field(min_length=1), AfterValidator(_ascending)]
    sha256: Annotated[dict[str, Sha256], AfterValidator(_all_tables)]


@with_config(STRICT)
class SourceFacts(TypedDict):
    """A data set that was merged into this one."""

    digest: Sha256
    settings: Demonstrator | None
    seed: Seed | None
    foods: Foods
    trials: Small


@with_config(STRICT)
class ManifestFacts(TypedDict):
    """The whole file: see `manifest.Manifest`."""

    schema: int
    cutgrammar: Version
    settings: Demonstrator | None
    seed: Seed | None
    definition: Line | None
    foods: Foods
    sources: list[SourceFacts]
    parts: Annotated[list[PartFacts], Field(min_length=1), AfterValidator(_apart)]


MANIFEST = TypeAdapter(ManifestFacts)
