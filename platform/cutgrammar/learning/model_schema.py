"""What `model.json` and `grammar.json` of a model may hold."""

from typing import Annotated, Any, NotRequired

import numpy as np
from pydantic import Field, JsonValue, TypeAdapter, with_config
from typing_extensions import TypedDict

from cutgrammar.grammar.type_statistics import TypeStatistics
from cutgrammar.untrusted.kinds import OPEN, STRICT, Digest, Identifier, Line, Number, Seed, Share, Small, Version, Word

MAX_TYPES = 10_000
Type = Annotated[int, Field(ge=0, lt=MAX_TYPES)]
FileName = Annotated[str, Field(pattern=r"^[a-z_]+\.(safetensors|json)$", max_length=100)]


@with_config(STRICT)
class ProvenanceFacts(TypedDict):
    """Where a model came from: see `model.Provenance`."""

    data: Digest
    split: Word
    split_digest: Digest
    trials: list[Small]
    seed: Seed
    package: Version


@with_config(STRICT)
class ModelFacts(TypedDict):
    """The file `model.json`; `Settings` checks the settings."""

    schema: int
    settings: dict[Identifier, JsonValue]
    provenance: ProvenanceFacts
    metrics: dict[Word, Number]
    files: dict[FileName, Digest]


@with_config(STRICT)
class ProductionFacts(TypedDict):
    """A production with its probability: see `grammar.production`."""

    parent: Type
    children: Annotated[list[Type], Field(min_length=2, max_length=1_000)]
    probability: Share
    text: NotRequired[Line]


@with_config(OPEN)
class InductionFacts(TypedDict):
    """How a grammar was chosen, and what is known of its types."""

    type_means: NotRequired[list[list[Number]]]
    type_statistics: NotRequired[dict[Identifier, list[Number | list[Number]]]]
    curve: NotRequired[list[dict[Identifier, Number | None]]]


@with_config(STRICT)
class GrammarFacts(TypedDict):
    """The file `grammar.json`."""

    k: Annotated[int, Field(ge=1, le=MAX_TYPES)]
    frequencies: list[Share]
    productions: Annotated[list[ProductionFacts], Field(max_length=1_000_000)]
    induction: InductionFacts


MODEL = TypeAdapter(ModelFacts)
GRAMMAR_FILE = TypeAdapter(GrammarFacts)


def check_types(facts: Any, features: int) -> None:
    """Check that what `grammar.json` says of its types fits their number, and features of this length.

    Raises:
        ValueError: it does not.
    """
    k, induction = facts["k"], facts["induction"]
    if "type_means" in induction and np.shape(induction["type_means"]) != (k, features):
        raise ValueError(f"induction.type_means are not {features} numbers for each of {k} types")
    if "type_statistics" in induction:
        try:
            found = len(TypeStatistics.from_json(induction["type_statistics"]).whole)
        except KeyError as error:
            raise ValueError(f"induction.type_statistics has no {error.args[0]}") from None
        except (TypeError, ValueError) as error:
            raise ValueError(f"induction.type_statistics is wrong: {error}") from None
        if found != k:
            raise ValueError(f"induction.type_statistics is of {found} types, not {k}")
