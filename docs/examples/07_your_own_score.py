"""8. Your own score: one `Score` under one entry point, without an edit of cutgrammar.

Save this file as `your_own_score.py` and install it on every node, as a package called `your-own-score` with the lines
below in its pyproject.toml. Each trial then has this score, too: in text, page and JSON of reports, in MLflow and in
`--help`.

    [project.entry-points."cutgrammar.scores"]
    volume_error = "your_own_score:VOLUME_ERROR"

Run: python docs/examples/07_your_own_score.py
"""

from functools import partial

from cutgrammar import SETUPS, Comparison, Score, goal_for, load_settings, score, stream
from cutgrammar_sim import carrot, make_demonstration


def volume_error(comparison: Comparison) -> float:
    """How much the volumes of matched fragments differ, as a share of the larger; 1 for one without a match."""
    errors = (abs(a.volume - b.volume) / max(a.volume, b.volume) for a, b, _ in comparison.pairs)
    return comparison.mean(errors, unmatched=1.0)


VOLUME_ERROR = Score(
    name="volume_error",
    label="volume error",
    help="Mean difference of the volumes of matched fragments, as a share of the larger one.",
    compute=volume_error,
    worst=1.0,
    higher_is_better=False,
)

if __name__ == "__main__":
    settings, streams = load_settings(None), partial(stream, 0, "example")
    demonstration = make_demonstration(0, SETUPS["N1M1"], ("chunks",), {"carrot": carrot}, 0, settings.demonstrator)
    goal = goal_for(demonstration, "in-place", streams("goal"))
    for name, reached in (("the goal itself", goal), ("the goal without a fragment", goal[1:])):
        print(f"{name}: volume error {score(reached, goal, [VOLUME_ERROR]).scores['volume_error']:.3f}")
