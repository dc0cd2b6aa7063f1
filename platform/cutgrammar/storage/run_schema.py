"""What `run.json` of a run may hold."""

from typing import Annotated, Any, NotRequired

from pydantic import Field, JsonValue, TypeAdapter, with_config
from typing_extensions import TypedDict

from cutgrammar.untrusted import check
from cutgrammar.untrusted.kinds import OPEN, Digest, Facts, Place, Seed, Small, Version, Word

Name = Annotated[str, Field(pattern=r"^\w{1,100}$")]
Digests = Annotated[list[Digest], Field(max_length=1_000)]
Places = Annotated[list[Place], Field(max_length=1_000)]


@with_config(OPEN)
class RunFile(TypedDict):
    """The file as it is since schema 2: see `run_folder.RunFacts`, which knows the names that may be there."""

    seed: Seed
    settings: dict[Name, Annotated[dict[Name, JsonValue], Field(max_length=1_000)]]
    data_digest: Digest
    missing: list[Small]
    split: Word
    split_digest: Digest
    model_digests: Annotated[Digests, Field(min_length=1)]
    package: Version
    data: Place
    models: Annotated[Places, Field(min_length=1)]
    commit: Version | None
    machine: Facts
    human: NotRequired[Places]
    human_digests: NotRequired[Digests]
    by_robot: NotRequired[bool]
    artifacts: NotRequired[Place]


_RUN = TypeAdapter(RunFile)


def as_schema_2(facts: dict[str, Any]) -> dict[str, Any]:
    """The facts of a run of schema 1, which had a single model, as those of schema 2."""
    rest = {name: value for name, value in facts.items() if name not in ("model", "model_digest")}
    return rest | {"models": [facts.get("model")], "model_digests": [facts.get("model_digest")]}


def check_run(facts: dict[str, Any]) -> None:
    """Check the facts of a run of schema 2.

    Raises:
        ValueError: a fact is missing or wrong, or there is not one digest for each model.
    """
    check(_RUN, facts)
    if len(facts["models"]) != len(facts["model_digests"]):
        raise ValueError(f"models are {len(facts['models'])}, but model_digests are {len(facts['model_digests'])}")
