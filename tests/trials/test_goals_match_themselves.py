"""The strict IoU of a goal with a remeshed, moved and shuffled copy of itself is 1."""

import pytest

from cutgrammar.demonstration import objects_of
from cutgrammar.geometry.fragment import Fragment
from cutgrammar.storage.data_set import DataSet
from cutgrammar.trials.goals import FOREIGN, GOALS, goal_for
from cutgrammar.trials.scoring import score


@pytest.mark.slow
@pytest.mark.parametrize("condition", GOALS)
def test_every_goal_matches_a_remeshed_moved_and_shuffled_copy_of_itself(
    condition, data_folder, rng, random_pose, remeshed
):
    data = DataSet.open(data_folder)
    for summary in data.trials:
        demonstration = data.demonstration(summary.trial)
        donors = objects_of(demonstration) if condition in FOREIGN else ()
        goal = goal_for(demonstration, condition, rng, donors)
        copy = [Fragment(remeshed(fragment.mesh, random_pose()), random_pose()) for fragment in goal]
        shuffled = tuple(copy[i] for i in rng.permutation(len(copy)))
        scored = score(shuffled, goal)
        assert scored.iou_strict == pytest.approx(1.0, abs=1e-9), summary
        assert scored.scores["iou"] == pytest.approx(1.0, abs=1e-9)
