"""Random hostile inputs of every reader: refused in one line or accepted, by readers that write nothing.

The inputs are those of `benchmarks/hostile_inputs.py --read`; a few hundred of the 20,000 run here, of another seed.
"""

import pytest

from cutgrammar.errors import InputError
from hostile.mutations import mutated
from hostile.reading import READERS, problems_of_random

SEED = 2026

pytestmark = pytest.mark.slow


def test_good_files_are_accepted(good):
    refused = {}
    for name, read in READERS.items():
        try:
            read(good)
        except InputError as error:
            refused[name] = str(error)
    assert not refused


def test_random_inputs_are_refused_in_one_line_or_accepted(good, clean_process, tmp_path):
    wrong = clean_process(problems_of_random, 600, SEED, good, tmp_path / "place")
    assert not wrong, "\n".join(wrong)


def test_an_input_is_the_same_for_the_same_seed(good, tmp_path):
    import shutil

    contents = []
    for number in range(2):
        folder = shutil.copytree(good, tmp_path / str(number))
        mutated(SEED, 3, "model").spoil(folder)
        contents.append((folder / "model/model.json").read_bytes())
    assert contents[0] == contents[1]
