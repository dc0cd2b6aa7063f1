"""The report as one HTML page that asks nothing of the network: tables, figures, pictures, the worst trials."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import write_atomic
from cutgrammar.geometry.fragment import Configuration
from cutgrammar.results.arm_work import ArmWork
from cutgrammar_dashboards.figures.trial_picture import trial_picture
from cutgrammar_dashboards.rendering.palette import Colour
from cutgrammar_dashboards.report.html_parts import escaped, folded, heads, row, table, whole_page
from cutgrammar_dashboards.report.score_charts import (
    colours_of,
    difference_chart,
    improvement_chart,
    profile_chart,
    score_chart,
)
from cutgrammar_dashboards.report.tables import (
    Condition,
    Section,
    against_reference,
    against_reference_by_setup,
    beside_the_paper,
    condition_of,
    other_scores_by_setup,
    outcomes,
    overview,
    strict_by_setup,
)

REFERENCE = "grammar"
"""The method that the others are compared with."""

IN_PLACE = "in-place"
"""The paper's goals, where they were cut."""


@dataclass(frozen=True)
class WorstTrial:
    """A trial that went badly.

    Attributes:
        name: within its run.
        status, reason: how it ended and why.
        iou_strict: its score.
        fragments: e.g. "7 of 9".
        command: shows it.
        recording: its address relative to the page, None where there is none.
    """

    name: str
    status: str
    reason: str | None
    iou_strict: float
    fragments: str
    command: str
    recording: str | None


@dataclass(frozen=True, eq=False)
class Picture:
    """A trial to be drawn; `pairs` are the (reached, goal) indices of its matched fragments."""

    title: str
    start: Configuration
    goal: Configuration
    reached: Configuration
    pairs: Sequence[tuple[int, int]] = ()


@dataclass(frozen=True, eq=False)
class PageDetails:
    """What the page shows beside the report's numbers.

    Attributes:
        differences: condition -> method -> setup -> strict IoU of its trials minus that of the reference method.
        worst: the worst trials of the reference method, worst first, then those of any method that failed.
        recordings: names and relative addresses of recordings.
        pictures: trials to draw.
        arm: what an arm did for each method, where one made the cuts.
        provenance: names and values: digests, settings, versions.
    """

    differences: Mapping[Condition, Mapping[str, Mapping[str, Sequence[float]]]] = field(default_factory=dict)
    worst: Sequence[WorstTrial] = ()
    recordings: Sequence[tuple[str, str]] = ()
    pictures: Sequence[Picture] = ()
    arm: Sequence[ArmWork] = ()
    provenance: Sequence[tuple[str, str]] = ()


def write_page(report: Mapping[str, Any], out: Path, title: str, details: PageDetails) -> None:
    """Write the page to `out`; what stands there is replaced once the new page is whole.

    Args:
        report: what `build_report` made.
        out: the file.
        title: the page's heading.
        details: what it shows beside the numbers.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(out, page(report, title, details).encode())


def page(report: Mapping[str, Any], title: str, details: PageDetails) -> str:
    """The page as text; all that is not ours is escaped."""
    conditions = list(dict.fromkeys(map(condition_of, report["rows"])))
    colours = colours_of((r["method"] for r in report["rows"]), report["shown"])
    parts = [f"<h1>{escaped(title)}</h1>", LEAD, _digest(report), GUIDE]
    parts += [f'<p class="note"><strong>Note</strong> {escaped(note)}</p>' for note in report.get("notes", ())]
    parts.append(_contents(conditions, details) if conditions else "<p>No trial has been evaluated yet.</p>")
    for i, condition in enumerate(conditions):
        parts += _condition(report, condition, details, colours, i)
    parts += [_arm(details.arm), _pictures(details.pictures), _worst(details.worst), _recordings(details.recordings)]
    parts.append(_provenance(details.provenance))
    return whole_page(title, parts)


LEAD = (
    "<p>How well each method cuts objects into the fragments of a goal, in the setups of Table I (N objects, M "
    "fragment categories). The data are ours, not the paper's: the numbers do not compare one to one with its "
    "Table I.</p>"
)

GUIDE = (
    "<details><summary>How to read the numbers</summary><dl>"
    "<dt>strict IoU</dt><dd>IoU of the best-matched pairs of fragments, summed and divided by the larger number of "
    "fragments, so that stopping early cannot win. It decides.</dd>"
    "<dt>matched IoU</dt><dd>the mean over the matched pairs only, as in the paper (IV-B2).</dd>"
    "<dt>refined IoU</dt><dd>strict IoU of the same pairs once a local search has refined the rotation of each, since "
    "the axes of near-cubes are noise.</dd>"
    "<dt>spectral</dt><dd>mean distance of the pairs by their Laplace-Beltrami eigenvalues, from 0 (the same) to 1, as "
    "which a fragment without counterpart counts; smaller is better.</dd>"
    "<dt>agreement</dt><dd>share, of the larger number of fragments, of those with the category of their counterpart "
    "in the goal and its volume but for 20 %.</dd>"
    "<dt>mean over setups, over trials</dt><dd>every setup counts once, as one averages the paper's table; every test "
    "trial counts once.</dd>"
    "<dt>&plusmn;</dt><dd>standard deviation of the mean over the runs: seeds of planning and execution with one "
    "trained model. None is given for a single run.</dd>"
    "<dt>n</dt><dd>test trials, each averaged over its runs. Trials that failed or got stuck count with what they "
    "reached; none is left out.</dd>"
    "<dt>failed, stuck, dead ends</dt><dd>runs of trials that ended so; cuts planned from a parse tree that cannot "
    "derive the goal.</dd>"
    "<dt>95 % interval</dt><dd>bootstrap over trials, resampled within their setup; none where a setup has a "
    "single trial.</dd>"
    "<dt>p</dt><dd>paired permutation test over trials; Holm: corrected for the methods and setups asked about, all "
    "setups together on their own.</dd>"
    "<dt>P(above)</dt><dd>probability of improvement: that a run of the one method scores above a run of the other on "
    "the same trial, averaged over trials; a tie counts half.</dd>"
    "<dt>&dagger;</dt><dd>the method is shown the trial's own demonstration, which the others never see: it tells what "
    "can be reached and does not compete.</dd></dl></details>"
)


def _condition(
    report: Mapping[str, Any], condition: Condition, details: PageDetails, colours: Mapping[str, Colour], number: int
) -> list[str]:
    section = Section.of(report, condition)
    goals, world, perception = map(escaped, condition)
    parts = [
        f'<h2 id="goals{number}">Goals {goals} <small>world {world}, perception {perception}</small></h2>',
        overview(section),
        _figure(
            score_chart(section.rows, colours, REFERENCE, f"scores{number}"),
            f"Mean strict IoU and its 95 % interval; the upright line is {REFERENCE}.",
        ),
        strict_by_setup(section),
        beside_the_paper(section, report["paper"]) if condition[0] == IN_PLACE else "",
        against_reference(section),
        _profiles(section, colours, number),
        against_reference_by_setup(section),
    ]
    if differences := details.differences.get(condition):
        chart = difference_chart(differences, REFERENCE, f"differences{number}")
        said = "Each dot is a test trial averaged over its runs; the bar is the mean of a method."
        parts.append(folded("Trial by trial", _figure(chart, said)))
    return [*parts, other_scores_by_setup(section), outcomes(section)]


def _profiles(section: Section, colours: Mapping[str, Colour], number: int) -> str:
    """Performance profiles and, beside them, the chance that the reference method is better."""
    shown = [name for name in section.methods if name in section.shown]
    said = "The share of runs whose strict IoU is above a threshold, with 95 % bands"
    figures = _figure(
        profile_chart(section.profiles, colours, shown, f"profiles{number}"),
        f"{said}; dashed: shown the demonstration." if shown else f"{said}.",
    )
    overall = [one for one in section.improvement if one["setup"] == "all"]
    if overall:
        figures += _figure(
            improvement_chart(overall, colours, f"improvement{number}"),
            f"How probably a run of {REFERENCE} scores above one of the method on the same trial.",
        )
    return f'<div class="beside">{figures}</div>'


def _figure(drawn: str, caption: str) -> str:
    return f"<figure>{drawn}<figcaption>{escaped(caption)}</figcaption></figure>"


def _digest(report: Mapping[str, Any]) -> str:
    return f'<p class="quiet">Digest of all but times: <code>{escaped(report["digest"])}</code></p>'


def _contents(conditions: Sequence[Condition], details: PageDetails) -> str:
    """Links to the parts of the page."""
    links = {f"goals{i}": f"Goals {goals}, {world}, {seen}" for i, (goals, world, seen) in enumerate(conditions)}
    links |= {"arm": "How the arm cut"} if details.arm else {}
    links |= {"reached": "What was reached"} if details.pictures else {}
    links |= {"worst": "The worst trials"} if details.worst else {}
    links |= {"recordings": "Recordings"} if details.recordings else {}
    links |= {"origin": "Where the numbers come from"} if details.provenance else {}
    items = "".join(f'<li><a href="#{where}">{escaped(name)}</a></li>' for where, name in links.items())
    return f"<nav><ul>{items}</ul></nav>"


def _arm(works: Sequence[ArmWork]) -> str:
    if not works:
        return ""
    body, reasons = [], []
    for work in works:
        name = f"{work.method}, {work.world}, {work.perception}"
        refused, failed = (sum(count for _, count in told) for told in (work.refused, work.failed))
        shares = (work.moved / work.cuts, work.turned / work.cuts, work.torque_share, work.velocity_share)
        moved, turned, torque, velocity = (f"{100 * share:.0f} %" for share in shares)
        cells = [str(work.cuts), moved, turned, str(refused), str(failed), f"{work.plane_error_deg:.3f}"]
        cells += [f"{work.plane_error_mm:.3f}", torque, velocity, f"{work.blade_force:.0f}"]
        cells += [str(work.broken), f"{work.seconds:.0f}"]
        body.append(row(name, cells, "bad" if work.broken else ""))
        told = [("refused", *pair) for pair in work.refused] + [("failed", *pair) for pair in work.failed]
        reasons += [
            row(name, [f'<td class="name">{what}</td>', str(count), f'<td class="name">{escaped(reason)}</td>'])
            for what, reason, count in told
        ]
    worst = ("plane off [degrees]", "plane off [mm]", "torque", "velocity", "force [N]")
    head = heads("method", "cuts", "moved", "turned", "refused", "failed", *worst, "limits broken", "seconds")
    said = "The worst of all cuts: plane, torque and velocity as shares of their limits, force on the blade."
    why = heads("method", "what", "how often", "why", words=("what", "why"))
    return (
        '<h2 id="arm">How the arm cut</h2>'
        + table(
            "Cuts that the arm made, and share of them for which the fragment was moved or turned", head, body, said
        )
        + (folded("Why cuts were refused or failed", table("Reasons", why, reasons)) if reasons else "")
    )


def _pictures(pictures: Sequence[Picture]) -> str:
    if not pictures:
        return ""
    drawn = [_figure(trial_picture(p.start, p.goal, p.reached, p.pairs), p.title) for p in pictures]
    return (
        '<h2 id="reached">What was reached</h2><p>Start, goal and what was reached. Fragments are drawn a little '
        "apart; those matched with one another have one colour, unmatched ones are grey.</p>" + "\n".join(drawn)
    )


def _worst(worst: Sequence[WorstTrial]) -> str:
    if not worst:
        return ""
    body = []
    for trial in worst:
        ended = trial.status + (f": {trial.reason}" if trial.reason else "")
        link = f' <a href="{escaped(trial.recording)}">recording</a>' if trial.recording else ""
        cells = [f"{trial.iou_strict:.3f}", escaped(trial.fragments), f'<td class="name">{escaped(ended)}</td>']
        body.append(row(trial.name, [*cells, f'<td class="name"><code>{escaped(trial.command)}</code>{link}</td>']))
    words = ("how it ended", "to see it")
    head = heads("trial", "strict IoU", "fragments", *words, words=words)
    return '<h2 id="worst">The worst trials</h2>' + table(
        f"Lowest strict IoU of {REFERENCE} first, then what failed of any method", head, body
    )


def _recordings(recordings: Sequence[tuple[str, str]]) -> str:
    if not recordings:
        return ""
    links = "".join(f'<li><a href="{escaped(where)}">{escaped(name)}</a></li>' for name, where in recordings)
    return f'<h2 id="recordings">Recordings</h2><p>For the rerun viewer.</p><ul>{links}</ul>'


def _provenance(provenance: Sequence[tuple[str, str]]) -> str:
    if not provenance:
        return ""
    body = [row(name, [f'<td class="name"><code>{escaped(value)}</code></td>']) for name, value in provenance]
    return '<h2 id="origin">Where the numbers come from</h2>' + table("Runs, digests, settings, versions", "", body)
