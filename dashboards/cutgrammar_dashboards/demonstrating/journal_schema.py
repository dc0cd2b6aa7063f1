"""What a line of a journal may hold; see `session` for what it means."""

from typing import Annotated, Any, Literal, NotRequired

from pydantic import Field, TypeAdapter, with_config
from typing_extensions import TypedDict

from cutgrammar.untrusted import check
from cutgrammar.untrusted.kinds import STRICT, Seconds, Sha256, Share, Small, fixed
from cutgrammar_dashboards.pages.messages import CODE

Coordinate = Annotated[float, Field(ge=-1_000, le=1_000)]


@with_config(STRICT)
class StrokeFacts(TypedDict):
    """A stroke: see `HandStroke`."""

    p_WE: fixed(Coordinate, 3)  # type: ignore[valid-type]
    first_W: fixed(Coordinate, 3)  # type: ignore[valid-type]
    second_W: fixed(Coordinate, 3)  # type: ignore[valid-type]
    explode: Share
    first_seconds: Seconds
    second_seconds: Seconds
    cut_seconds: Seconds


@with_config(STRICT)
class StartFacts(TypedDict):
    """A participant began the task whose objects have this digest."""

    do: Literal["start"]
    participant: Annotated[str, Field(pattern=CODE)]
    robot: bool
    start: Sha256


@with_config(STRICT)
class CutFacts(TypedDict):
    """A cut."""

    do: Literal["cut"]
    fragment: Small
    plane_W: fixed(Coordinate, 4)  # type: ignore[valid-type]
    stroke: StrokeFacts
    robot: bool
    seconds: Seconds


@with_config(STRICT)
class ActionFacts(TypedDict):
    """Any other action."""

    do: Literal["resume", "undo", "save"]
    robot: bool
    seconds: NotRequired[Seconds]


_ENTRY = TypeAdapter[Any](Annotated[StartFacts | CutFacts | ActionFacts, Field(discriminator="do")])


def check_entry(entry: Any, is_first: bool) -> None:
    """Check a line of a journal, of which the first, and no other, is a start.

    Raises:
        ValueError: something is missing or wrong; the message names it.
    """
    check(_ENTRY, entry)
    if (entry["do"] == "start") != is_first:
        raise ValueError(f"do = {entry['do']!r} is at the wrong place")
