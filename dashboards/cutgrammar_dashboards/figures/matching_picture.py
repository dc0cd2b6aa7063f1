"""The paper's Fig. 5 on our data: matched pairs of reached and goal fragments, and the fragments without a match."""

from matplotlib.figure import Figure

from cutgrammar_dashboards.figures.layout.sheet import MARGIN, PORTRAIT, new_sheet, portrait, scale_to_fit, seen_size
from cutgrammar_dashboards.figures.methods_picture import TrialResults, unused
from cutgrammar_dashboards.rendering.palette import UNMATCHED, soft_graded

CELL, HEAD, SIDE = 1.15, 0.95, 0.75
"""Width of a pair, height of the heading, width of the text before a row [inches]."""


def draw_matching(trial: TrialResults, title: str, pairs_per_row: int) -> Figure:
    """The matched pairs of the first result of a trial, the best first, and the fragments without a match.

    Args:
        trial: the trial.
        title: heading of the sheet.
        pairs_per_row: maximum number of pairs in a row.
    """
    result, goal = trial.results[0], trial.goal
    pairs = sorted(result.pairs, key=lambda pair: -pair[2])
    columns: list[tuple[int | None, int | None, float | None]] = [*pairs]
    columns += [(None, j, None) for j in unused(len(goal), [j for _, j, _ in pairs])]
    columns += [(i, None, None) for i in unused(len(result.fragments), [i for i, *_ in pairs])]
    goal_bodies = {j: portrait(fragment.shape, UNMATCHED) for j, fragment in enumerate(goal)}
    bodies = {i: portrait(fragment.shape, UNMATCHED) for i, fragment in enumerate(result.fragments)}
    for i, j, iou in pairs:
        goal_bodies[j] = portrait(goal[j].shape, soft_graded(iou))
        bodies[i] = portrait(result.fragments[i].shape, soft_graded(iou), result.flip(i, goal[j].shape))
    everything = [*goal_bodies.values(), *bodies.values()]
    scale = min(scale_to_fit([body], PORTRAIT, CELL - 0.10, 0.9) for body in everything)
    high = scale * max(seen_size([body], PORTRAIT)[1] for body in everything)
    row_height = 2.0 * high + 1.05
    rows = -(-len(columns) // pairs_per_row)
    per_row = -(-len(columns) // rows)  # the same number in every row
    subtitle = (
        f"{len(pairs)} matched pairs, best first; {len(goal)} fragments in the goal, {len(bodies)} reached; "
        f"strict IoU {result.iou_strict:.3f}. Grey: without a match."
    )
    width = max(2.0 * MARGIN + SIDE + per_row * CELL, 7.2)
    with new_sheet(width, HEAD + rows * row_height, title, subtitle) as sheet:
        for n, (reached, wanted, share) in enumerate(columns):
            x, y = MARGIN + SIDE + (n % per_row + 0.5) * CELL, HEAD + row_height * (n // per_row)
            above, below = y + high / 2.0, y + 1.5 * high + 0.62
            if n % per_row == 0:
                sheet.write(MARGIN, above, "goal", fontweight="bold")
                sheet.write(MARGIN, below, "reached", fontweight="bold")
            if wanted is not None:
                sheet.place([goal_bodies[wanted]], PORTRAIT, (x, above), scale)
            if reached is not None:
                sheet.place([bodies[reached]], PORTRAIT, (x, below), scale)
            if share is not None:
                middle = (above + below) / 2.0
                sheet.write(x, middle, f"{share:.2f}", ha="center", fontsize=9)
                for top, bottom in ((y + high + 0.06, middle - 0.10), (middle + 0.10, y + high + 0.56)):
                    sheet.line([(x, top), (x, bottom)], linestyle=(0, (1.5, 2.2)), linewidth=1.3)
    return sheet.figure
