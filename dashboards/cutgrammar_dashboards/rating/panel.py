"""The raters of one server: who is shown which pair, and what is kept of their answers.

A rater's order follows from the plan and from what they have answered, so that it survives the death of the server:
answered pairs first, in the order in which they were shown, then those of the plan that are left.
"""

import hashlib
import hmac
import secrets
import threading
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime

from cutgrammar.storage.ratings import Rating, RatingStore, last_answers
from cutgrammar.trials.rating_plan import Pair
from cutgrammar_dashboards.pages.refusal import RefusedError


class Rater:
    """One rater's pairs and answers.

    Attributes:
        code: of the rater.
        pairs: in the order in which they are shown.
        answers: number of answers kept, changes included.
        lock: to be held by who reads or changes the rater.
    """

    def __init__(self, code: str, pairs: Sequence[Pair], given: Sequence[Rating]) -> None:
        self.code, self.pairs, self.lock = code, tuple(pairs), threading.Lock()
        self.answers = len(given)
        self._ratings = {rating.pair: rating for rating in last_answers(given)}

    @property
    def answered(self) -> int:
        """Number of pairs that have an answer; they are the first ones."""
        return sum(pair.digest in self._ratings for pair in self.pairs)

    def rating(self, pair: Pair) -> Rating | None:
        """The last answer to a pair."""
        return self._ratings.get(pair.digest)

    def keep(self, rating: Rating) -> None:
        """Take up an answer that is on disk."""
        self._ratings[rating.pair] = rating
        self.answers += 1


class Panel:
    """All raters; several threads may use it."""

    def __init__(
        self,
        stores: Mapping[str, RatingStore],
        pairs: Mapping[str, Pair],
        plan: Callable[[str], Sequence[Pair]],
        finished: Callable[[], None] = lambda: None,
    ) -> None:
        """Open the panel.

        Args:
            stores: digest of a trial's key -> where the answers about it are kept.
            pairs: digest -> pair, of pairs that were answered before.
            plan: the pairs of a rater, always the same (see `rating_plan`).
            finished: called when a rater has answered their last pair.
        """
        self._stores, self._pairs, self._plan, self._finished = stores, pairs, plan, finished
        self._lock = threading.Lock()
        self._secret = secrets.token_bytes(16)
        self._raters: dict[str, Rater] = {}
        self._key_of: dict[str, str] = {}  # code -> the key that counts
        self._by_key: dict[str, Rater] = {}

    def join(self, code: str) -> tuple[str, Rater]:
        """A new key for a rater, which makes older ones invalid, and the rater."""
        with self._lock:
            if code not in self._raters:
                self._raters[code] = self._opened(code)
            rater = self._raters[code]
            self._by_key.pop(self._key_of.pop(code, ""), None)
            key = secrets.token_urlsafe(18)
            self._by_key[key], self._key_of[code] = rater, key
            return key, rater

    def rater(self, key: str) -> Rater:
        """The rater with a key.

        Raises:
            RefusedError: the key is unknown, or the rater has continued elsewhere.
        """
        rater = self._by_key.get(key)
        if rater is None:
            raise RefusedError(403, "this page is no longer connected to your ratings; enter your code to continue")
        return rater

    def name(self, rater: Rater, pair: Pair) -> str:
        """What the browser calls a pair: it says nothing, and differs from rater to rater and server to server."""
        return hmac.new(self._secret, f"{rater.code} {pair.digest}".encode(), hashlib.sha256).hexdigest()[:24]

    def answer(self, rater: Rater, name: str, after: int, rating: int, seconds: float, robot: bool) -> int:
        """Keep an answer; when this returns, it is on disk. The rater's lock must be held.

        Args:
            rater: who answers.
            name: of the pair.
            after: number of answers that the page has seen; another number means a repeated or lost request.
            rating: the answer.
            seconds: since the pair was shown [s].
            robot: whether a test robot answers.

        Returns:
            The place of the pair.

        Raises:
            RefusedError: the request is out of date, or the pair has not been shown to this rater.
            OSError: it cannot be kept; nothing has changed.
        """
        if after != rater.answers:
            raise RefusedError(409, "this page is out of date; it is loaded again")
        answered = rater.answered
        shown = {self.name(rater, pair): place for place, pair in enumerate(rater.pairs[: answered + 1])}
        if name not in shown:
            raise RefusedError(422, "this pair has not been shown to you")
        pair, before = rater.pairs[shown[name]], rater.rating(rater.pairs[shown[name]])
        kept = Rating(
            rater=rater.code,
            robot=robot,
            pair=pair.digest,
            kind=pair.kind,
            trial=pair.key.digest,
            other=pair.other.digest if pair.other else None,
            place=shown[name],
            answer=before.answer + 1 if before else 1,
            rating=rating,
            seconds=seconds,
            at=datetime.now(UTC).isoformat(timespec="seconds"),
        )
        with self._lock:
            self._stores[pair.key.digest].add(kept)
        rater.keep(kept)
        if answered < rater.answered == len(rater.pairs):
            self._finished()
        return shown[name]

    def _opened(self, code: str) -> Rater:
        stores = dict.fromkeys(self._stores.values())
        given = [rating for store in stores for rating in store.all() if rating.rater == code]
        known = [rating for rating in given if rating.pair in self._pairs]
        first = {rating.pair: rating for rating in known if rating.answer == 1}
        answered = [self._pairs[digest] for digest in sorted(first, key=lambda digest: first[digest].place)]
        plan = self._plan(code)
        left = [pair for pair in plan if pair.digest not in first]
        return Rater(code, [*answered, *left[: max(len(plan) - len(answered), 0)]], known)
