"""What `show` tells of a run in which an arm made the cuts."""

from cutgrammar_pipelines.config import ShowConfig
from cutgrammar_pipelines.inspection.show import show


def test_a_run_of_an_arm_tells_how_it_cut(arm_run, capsys):
    assert show(ShowConfig(arm_run)) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-2:] == [
        "  arm of kinova, truth, grammar: 1 cuts in 4 s simulated, 0 % moved first, 0 % turned",
        "    at worst: plane off by 0.010 degrees and 0.020 mm, torque 60 % and velocity 40 % of their limits, 25 N on "
        "the blade; all limits kept",
    ]


def test_a_run_without_an_arm_says_nothing_of_one(scored_run, capsys):
    assert show(ShowConfig(scored_run)) == 0
    assert "arm of" not in capsys.readouterr().out
