import numpy as np

from wrong_counts import classes_of, summary


def test_looks_are_divided_into_classes():
    owners = np.repeat([0, 1, 2, 3, -1], [100, 100, 100, 5, 50])
    right = np.repeat([0, 1, 2, 3, -1], [100, 100, 100, 5, 50])
    nothing = {"joined": 0, "left out": 0, "split": 0, "remembered": 0}
    assert classes_of(owners, right, 4, 4) == {"hidden": 1} | nothing
    joined = np.repeat([0, 0, 1, -1, -1], [100, 100, 100, 5, 50])
    assert classes_of(owners, joined, 4, 3) == {"hidden": 1} | nothing | {"joined": 1, "remembered": 1}
    split = np.repeat([0, 1, 2, -1, -1], [60, 40, 100, 100 + 5, 50])
    assert classes_of(owners, split, 4, 3) == {"hidden": 1} | nothing | {"left out": 1, "split": 1}


def test_trials_count_by_their_last_look():
    right = dict.fromkeys(("hidden", "joined", "left out", "split", "remembered"), 0)
    rows = [right | {"too_many": number} for number in (0, 1, -1)]
    numbers = summary([rows, rows[:2], rows[:1]])
    assert (numbers["too_many_at_the_end"], numbers["too_few_at_the_end"]) == (1, 1)
    assert (numbers["looks"], numbers["wrong_looks"]) == (6, 3)
