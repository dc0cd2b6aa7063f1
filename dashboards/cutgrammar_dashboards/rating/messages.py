"""What the rating page sends beside what all pages send."""

from typing import Annotated

from pydantic import Field

from cutgrammar.storage.ratings import HIGHEST, LOWEST
from cutgrammar_dashboards.pages.messages import Message, Seconds


class Answer(Message):
    """A rating of the pair `pair`, after the page has seen that `after` answers of this rater are kept.

    Attributes:
        seconds: since the pair was shown [s].
    """

    after: Annotated[int, Field(ge=0, le=1_000_000)]
    pair: Annotated[str, Field(pattern="^[0-9a-f]{24}$")]
    rating: Annotated[int, Field(ge=LOWEST, le=HIGHEST, strict=True)]
    seconds: Seconds
