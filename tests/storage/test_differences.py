from cutgrammar.storage.differences import first_difference


def test_what_differs_is_named_with_its_table_and_both_values():
    there = {"seed": 0, "search": {"keys": 4, "rounds": 50}}
    assert first_difference(there, {"seed": 0, "search": {"keys": 4, "rounds": 50}}) is None
    assert first_difference(there, {"seed": 0, "search": {"keys": 4, "rounds": 8}}) == "search.rounds = 50, not 8"
    assert first_difference(there | {"old": 1}, there) == "old = 1, not None"
    assert first_difference({"data": "a" * 64}, {"data": "b" * 64}) == "data = aaaaaaaaaaaa..., not bbbbbbbbbbbb..."
