"""A trial of a report: its picture, and its fragments for those who can turn them."""

from dataclasses import dataclass

from cutgrammar.geometry.fragment import Mesh
from cutgrammar.results.report import TrialPicture
from cutgrammar_dashboards.figures.trial_picture import pair_colours, trial_picture
from cutgrammar_dashboards.report.inline_svg import hex_of
from cutgrammar_dashboards.report.panels import Panels

MAX_BYTES = 4_000_000
"""Size of the fragments of all trials of a page; further trials have only their pictures. With the pictures of 60
trials, the charts and the script, a page stays below 6 MB."""


@dataclass(frozen=True)
class DrawnTrial:
    """A trial as a page shows it.

    Attributes:
        picture: an element <img>.
        fragments: what can be turned, as JSON; "" where there is nothing.
        colours: of the goal's fragments, as in CSS.
        why_not: why nothing can be turned, where that needs words.
    """

    picture: str
    fragments: str
    colours: tuple[str, ...]
    why_not: str


class TrialDrawer:
    """Draws the trials of a page, until their fragments together are as large as `max_bytes`."""

    def __init__(self, max_bytes: int = MAX_BYTES) -> None:
        self._left = max_bytes

    def draw(self, trial: TrialPicture) -> DrawnTrial:
        """One trial."""
        results = [(result.fragments, result.pairs) for result in trial.results]
        colours, _ = pair_colours(len(trial.goal), [(len(fragments), pairs) for fragments, pairs in results])
        fragments, why_not = "", ""
        shown = (*trial.goal, *(fragment for reached, _ in results for fragment in reached))
        if trial.goal and all(isinstance(fragment.shape, Mesh) for fragment in shown):
            fragments = Panels(trial).to_json()
            if len(fragments) > self._left:
                fragments, why_not = "", "A picture only, since the page would become too large otherwise."
            self._left -= len(fragments)
        picture = trial_picture(trial.start, trial.goal, results)
        return DrawnTrial(picture, fragments, tuple(map(hex_of, colours)), why_not)
