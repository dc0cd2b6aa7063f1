"""Made-up ratings for tests."""

from cutgrammar.storage.ratings import Rating
from cutgrammar.trials.rating_plan import RESULT, Pair


def answer(rater, pair, rating, place=0, answer=1, robot=False):
    other = pair.other.digest if pair.other else None
    return Rating(
        rater, robot, pair.digest, pair.kind, pair.key.digest, other, place, answer, rating, 2.5, "2026-11-27T09:00:00Z"
    )


def answers(rater, ratings, robot=False):
    """One answer for each (pair, rating)."""
    return [answer(rater, pair, rating, place, robot=robot) for place, (pair, rating) in enumerate(ratings)]


def result(key):
    return Pair(RESULT, key)
