"""The file of ratings: what is kept, and which files and rows are refused."""

import os
import sqlite3
from dataclasses import replace

import pytest

from cutgrammar.errors import InputError
from cutgrammar.storage.ratings import RatingStore, last_answers, ratings_of, read_ratings
from cutgrammar.trials.rating_plan import OTHER, SAME, Pair
from cutgrammar.trials.record import TrialKey
from made_ratings import answer, result

KEYS = [TrialKey("N1M1", trial, "in-place", "bc", 0, "bench", "truth", "o") for trial in range(3)]


@pytest.fixture
def store(tmp_path):
    opened = RatingStore(ratings_of(tmp_path))
    yield opened
    opened.close()


def test_what_was_added_is_read_in_order(store, tmp_path):
    given = [
        answer("P1", result(KEYS[0]), 3),
        answer("P2", Pair(SAME, KEYS[1]), 5, robot=True),
        answer("P1", Pair(OTHER, KEYS[1], KEYS[2]), 1, place=1),
        answer("P1", result(KEYS[0]), 4, answer=2),
    ]
    for one in given:
        store.add(one)
    assert read_ratings(tmp_path) == store.all() == given
    assert last_answers(given) == [given[3], given[2], given[1]]


def test_a_run_without_ratings_has_none(tmp_path):
    assert read_ratings(tmp_path) == []


def test_an_answer_cannot_be_given_twice(store):
    store.add(answer("P1", result(KEYS[0]), 3))
    with pytest.raises(InputError, match="refuses a rating"):
        store.add(answer("P1", result(KEYS[0]), 5))
    assert [one.rating for one in store.all()] == [3]


@pytest.mark.parametrize(
    "wrong", [{"rating": 0}, {"rating": 6}, {"kind": "new"}, {"rater": ""}, {"seconds": -1.0}, {"other": "x"}]
)
def test_a_row_out_of_bounds_is_refused(store, wrong):
    with pytest.raises(InputError, match="refuses a rating"):
        store.add(replace(answer("P1", result(KEYS[0]), 3), **wrong))
    assert store.all() == []


def test_one_server_at_a_time(store):
    with pytest.raises(InputError, match="rated on another server"):
        RatingStore(store.path)


def test_a_torn_file_is_refused(store, tmp_path):
    for number in range(200):
        store.add(answer("P1", result(replace(KEYS[0], trial=number)), 3, place=number))
    store.close()
    content = store.path.read_bytes()
    store.path.write_bytes(content[: len(content) // 2] + os.urandom(len(content) // 4))
    for use in (lambda: read_ratings(tmp_path), lambda: RatingStore(store.path)):
        with pytest.raises(InputError, match="torn"):
            use()


def test_a_file_whose_schema_is_no_text_is_refused(store, tmp_path):
    store.add(answer("P1", result(KEYS[0]), 3))
    store.close()
    content = store.path.read_bytes()
    store.path.write_bytes(content.replace(b"CREATE TABLE ratings", b"CREATE TABXX rat\xff\xacgs"))
    with pytest.raises(InputError, match="torn or foreign"):
        read_ratings(tmp_path)


def test_a_foreign_file_is_refused(tmp_path):
    path = ratings_of(tmp_path)
    for content in (b"", b"not a database, but long enough to be looked at" * 40):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"torn or foreign|does not hold ratings"):
            read_ratings(tmp_path)
    path.unlink()
    other = sqlite3.connect(path)
    other.execute("CREATE TABLE ratings (rater TEXT)")
    other.commit()
    other.close()
    for use in (lambda: read_ratings(tmp_path), lambda: RatingStore(path)):
        with pytest.raises(InputError, match="does not hold ratings"):
            use()


def test_another_table_or_schema_is_refused(store, tmp_path):
    store.close()
    changed = sqlite3.connect(store.path)
    changed.execute("ALTER TABLE ratings ADD COLUMN more TEXT")
    changed.commit()
    with pytest.raises(InputError, match="one table"):
        read_ratings(tmp_path)
    changed.execute("PRAGMA user_version = 9")
    changed.commit()
    changed.close()
    with pytest.raises(InputError, match="schema 9"):
        read_ratings(tmp_path)
