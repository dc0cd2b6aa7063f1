"""What records tell of an arm's cuts is summed up method by method."""

import dataclasses

import pytest

from cutgrammar.motion import Execution
from cutgrammar.results.arm_work import arm_work
from cutgrammar.trials.record import Record, TrialKey

LAY = Execution(None, 0.0, 0.0, 0.01, 0.02, 5.0, 20.0, 0.5, 0.7, True)
TURNED = Execution("lies flat", 90.0, 0.05, 0.03, 0.01, 9.0, 30.0, 0.6, 0.75, True)
CARRIED = Execution("a neighbour is in the way", 0.0, 0.08, 0.02, 0.01, 8.0, 10.0, 1.2, 0.8, False, set_aside=2)


def cut(execution):
    event = {"event": "CutMade", "step": 1, "products": 2, "fragments": 2}
    return event | ({"execution": dataclasses.asdict(execution)} if execution else {})


def refused(reason):
    return {"event": "CutRefused", "step": 1, "attempt": 0, "reason": reason}


def record(method, events, world="kinova"):
    key = TrialKey("N1M1", 0, "in-place", method, 0, world, "truth", "o" * 64)
    return Record(key, "0.1.0", None, "done", None, None, {"iou_strict": 0.5}, 2, 2, 1, 0, 0, 0.1, 0.2, tuple(events))


def test_cuts_are_counted_and_the_worst_is_kept():
    flat, near = "the plane is 71.5 degrees from the vertical", "a neighbour is in the blade's way: fragment 3"
    (work,) = arm_work(
        [
            record("grammar", [cut(LAY), refused(flat), cut(TURNED), refused(near)]),
            record("grammar", [refused(flat.replace("71.5", "64")), cut(CARRIED)]),
            record("grammar", [cut(LAY), {"event": "CutFailed", "step": 2, "reason": "a fragment left the board"}]),
        ]
    )
    assert (work.world, work.perception, work.method) == ("kinova", "truth", "grammar")
    assert (work.cuts, work.moved, work.turned, work.cleared, work.broken) == (4, 2, 1, 1, 1)
    assert (work.plane_error_deg, work.plane_error_mm) == (0.03, 0.02)
    assert (work.torque_share, work.velocity_share, work.blade_force) == (1.2, 0.8, 30.0)
    assert work.seconds == 27.0
    assert work.refused == (
        ("the plane is … degrees from the vertical", 2),
        ("a neighbour is in the blade's way: fragment …", 1),
    )
    assert work.failed == (("a fragment left the board", 1),)


def test_records_that_do_not_say_what_was_set_aside_are_read():
    old = {name: value for name, value in cut(CARRIED)["execution"].items() if name != "set_aside"}
    (work,) = arm_work([record("grammar", [{**cut(CARRIED), "execution": old}])])
    assert (work.moved, work.cleared) == (1, 0)


def test_methods_and_worlds_are_counted_apart_and_worlds_without_an_arm_left_out():
    made = [record(m, [cut(LAY)]) for m in ("random", "grammar")] + [record("grammar", [cut(None)], "bench")]
    made += [record("grammar", [cut(LAY)], "another")]
    assert [(w.world, w.method) for w in arm_work(made)] == [
        ("another", "grammar"),
        ("kinova", "grammar"),
        ("kinova", "random"),
    ]


@pytest.mark.parametrize("events", [[], [refused("too flat")], [cut(None)]])
def test_without_a_cut_by_an_arm_there_are_no_entries(events):
    assert arm_work([record("grammar", events)]) == []
