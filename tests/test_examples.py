"""The documented examples run and print the expected results; some use results of earlier ones."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from cutgrammar import DataSet, load_model, trajectory_from_json

EXAMPLES = sorted((Path(__file__).parent.parent / "docs" / "examples").glob("[0-9]*.py"))
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("examples")


@pytest.fixture(scope="module")
def printed(folder):
    """A function: number of an example -> its output. The examples that it builds on run first, each once."""
    outputs = {}

    def output(number):
        for example in EXAMPLES:
            found = int(example.name[:2])
            if found in outputs or found not in (number, *BUILDS_ON.get(number, ())):
                continue
            command = [sys.executable, str(example), str(folder)]
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
            outputs[found] = done.stdout
        return outputs[number]

    return output


BUILDS_ON = {3: (2,), 4: (2,)}


def test_every_example_has_a_test_of_its_own():
    tests = "\n".join(name for name in globals() if name.startswith("test_example_"))
    assert all(f"test_example_{int(example.name[:2])}_" in tests for example in EXAMPLES)


def test_example_1_cuts_a_carrot_into_fragments_whose_volumes_add_up(printed):
    text = printed(1)
    whole, *parts = (int(volume) for volume in re.findall(r"of (\d+) ml", text))
    assert len(parts) == 2
    assert abs(whole - sum(parts)) <= 1  # each is rounded
    assert "Missed(" in text
    assert "halves against themselves: 1.000" in text
    assert float(re.search(r"one half against both: +([\d.]+)", text)[1]) == pytest.approx(0.5, abs=0.01)


def test_example_2_makes_a_data_set_and_a_grammar_of_its_demonstrations(printed, folder):
    text = printed(2)
    assert len(DataSet.open(folder / "data").trials) == 20
    assert "20 trials, digest" in text
    rules = re.findall(r"^  (\d\.\d\d)  (c\d+) -> ", text, flags=re.M)
    assert len(rules) == len(load_model(folder / "model").grammar.probabilities)
    for left in {left for _, left in rules}:
        assert sum(float(p) for p, name in rules if name == left) == pytest.approx(1.0, abs=0.02)


def test_example_3_plans_and_cuts_until_the_goal_has_its_fragments(printed):
    text = printed(3)
    (last, wanted) = re.findall(r"now (\d+) of (\d+) fragments", text)[-1]
    assert last == wanted
    assert 0.0 < float(re.search(r"strict IoU ([\d.]+)", text)[1]) <= 1.0


def test_example_4_reports_every_method_and_records_every_trial(printed, folder):
    text = printed(4)
    assert all(method in text for method in ("grammar", "random", "replay"))
    assert re.search(
        r"^replay †?(?: +\d+)+ +1\.000", text, flags=re.M
    )  # it sees the demonstration, and repeats it exactly
    assert len(list((folder / "run" / "recordings").glob("*.rrd"))) == 6


def test_example_6_plays_two_cuts_within_the_limits_of_the_arm(printed, folder):
    text = printed(6)
    assert text.count("Done(products=2") == 2
    assert text.count("limits_kept=True") == 2
    assert "2 cuts were played" in text
    assert not trajectory_from_json((folder / "cut.json").read_bytes()).violations()


def test_example_5_adds_a_method_that_cuts_until_the_goal_has_its_fragments(printed):
    text = printed(5)
    made, wanted = re.search(r"(\d+) of (\d+) fragments", text).groups()
    assert int(made) >= int(wanted)
    assert 0.0 < float(re.search(r"strict IoU ([\d.]+)", text)[1]) <= 1.0


def test_example_7_adds_a_score_that_is_0_for_the_goal_and_more_without_a_fragment(printed):
    whole, less = (float(error) for error in re.findall(r"volume error ([\d.]+)", printed(7)))
    assert whole == 0.0
    assert less > 0.0
