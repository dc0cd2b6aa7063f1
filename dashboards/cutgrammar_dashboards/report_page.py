"""The report as one HTML page that asks nothing of the network: tables, figures, pictures, the worst trials."""

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

from cutgrammar.durable import write_whole
from cutgrammar.geometry.fragment import Configuration
from cutgrammar_dashboards.figures import difference_chart, score_chart, trial_picture

Condition = tuple[str, str, str]
"""Goals, world, perception."""


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
        worst: the worst trials, worst first.
        recordings: names and relative addresses of recordings.
        pictures: trials to draw.
        provenance: names and values: digests, settings, versions.
    """

    differences: Mapping[Condition, Mapping[str, Mapping[str, Sequence[float]]]] = field(default_factory=dict)
    worst: Sequence[WorstTrial] = ()
    recordings: Sequence[tuple[str, str]] = ()
    pictures: Sequence[Picture] = ()
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
    write_whole(out, page(report, title, details).encode())


def page(report: Mapping[str, Any], title: str, details: PageDetails) -> str:
    """The page as text; all that is not ours is escaped."""
    parts = [f"<h1>{_e(title)}</h1>", LEAD]
    parts += [f'<p class="note"><strong>Note</strong> {_e(note)}</p>' for note in report.get("notes", ())]
    conditions = list(dict.fromkeys((r["goals"], r["world"], r["perception"]) for r in report["rows"]))
    if not conditions:
        parts.append("<p>No trial has been evaluated yet.</p>")
    for number, condition in enumerate(conditions):
        parts.append(_condition(report, condition, details, number))
    parts.append(_pictures(details.pictures))
    parts.append(_worst(details.worst))
    parts.append(_recordings(details.recordings))
    parts.append(_provenance(details.provenance))
    style = (files("cutgrammar_dashboards") / "report_page.css").read_text()
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
        "img-src data:; style-src 'unsafe-inline'\">"
        f"<title>{_e(title)}</title><style>{style}</style></head>\n<body><main>\n"
        + "\n".join(part for part in parts if part)
        + "\n</main></body></html>\n"
    )


LEAD = (
    "<p>How well each method cuts objects into the fragments of a goal, in the setups of Table I (N objects, M "
    "fragment categories). The data are ours, not the paper's: the numbers do not compare one to one with its "
    "Table I.</p>"
    "<details><summary>How to read the numbers</summary><dl>"
    "<dt>strict IoU</dt><dd>IoU of the best-matched pairs of fragments, summed and divided by the larger number of "
    "fragments, so that stopping early cannot win. It decides.</dd>"
    "<dt>matched IoU</dt><dd>the mean over the matched pairs only, as in the paper (IV-B2).</dd>"
    "<dt>&plusmn;</dt><dd>standard deviation of the mean over the runs: seeds of planning and execution with one "
    "trained model. None is given for a single run.</dd>"
    "<dt>n</dt><dd>test trials, each averaged over its runs. Trials that failed or got stuck count with what they "
    "reached; none is left out.</dd>"
    "<dt>95 % interval</dt><dd>bootstrap over trials, resampled within their setup; none where a setup has a "
    "single trial.</dd>"
    "<dt>p</dt><dd>paired permutation test over trials; Holm: corrected for the methods and setups asked about, all "
    "setups together on their own.</dd></dl></details>"
)


def _condition(report: Mapping[str, Any], condition: Condition, details: PageDetails, number: int) -> str:
    goals, world, perception = condition
    rows = [r for r in report["rows"] if (r["goals"], r["world"], r["perception"]) == condition]
    tests = [t for t in report["tests"] if (t["goals"], t["world"], t["perception"]) == condition]
    parts = [
        f"<h2>Goals {_e(goals)}, world {_e(world)}, perception {_e(perception)}</h2>",
        _scores("Strict IoU", rows, "iou_strict"),
        f"<figure>{score_chart(rows, f'scores{number}')}"
        "<figcaption>Mean strict IoU; the lines are 95 % intervals, where there are any.</figcaption></figure>",
    ]
    differences = details.differences.get(condition)
    if differences:
        parts.append(
            f"<figure>{difference_chart(differences, tests[0]['against'], f'differences{number}')}<figcaption>"
            "Each dot is a test trial averaged over its runs; the bar is the mean of a method.</figcaption></figure>"
        )
    parts += [_tests(tests), _scores("Matched IoU, the paper's", rows, "iou"), _outcomes(rows)]
    return "\n".join(part for part in parts if part)


def _scores(caption: str, rows: Sequence[Mapping[str, Any]], score: str) -> str:
    methods, setups = _unique(r["method"] for r in rows), _unique(r["setup"] for r in rows)
    cells = {(r["setup"], r["method"]): r for r in rows}
    body = []
    for setup in setups:
        trials = max(r["trials"] for r in rows if r["setup"] == setup)
        line = [f'<th scope="row">{_e(setup)}</th><td class="n">{trials}</td>']
        line += [_score_cell(cells.get((setup, method)), score) for method in methods]
        body.append(f"<tr{' class=all' if setup == 'all' else ''}>{''.join(line)}</tr>")
    heads = "".join(f'<th scope="col">{_e(method)}</th>' for method in methods)
    return _table(caption, f'<th scope="col">setup</th><th scope="col" class="n">n</th>{heads}', body)


def _score_cell(row: Mapping[str, Any] | None, score: str) -> str:
    if row is None or row[f"{score}_mean"] is None:
        return "<td>&ndash;</td>"
    mean, spread, interval = row[f"{score}_mean"], row[f"{score}_std_runs"], row.get(f"{score}_ci95")
    text = f"{mean:.3f}" + ("" if spread is None else f" <small>&plusmn; {spread:.3f}</small>")
    text += "" if interval is None else f"<br><small>{interval[0]:.3f} to {interval[1]:.3f}</small>"
    return f"<td>{text}</td>"


def _tests(tests: Sequence[Mapping[str, Any]]) -> str:
    """The tests over all setups, and those of each setup folded away."""
    overall = [test for test in tests if test["setup"] == "all"]
    single = [test for test in tests if test["setup"] != "all"]
    folded = f"<details><summary>Setup by setup</summary>{_test_table(single)}</details>" if single else ""
    return _test_table(overall) + folded


def _test_table(tests: Sequence[Mapping[str, Any]]) -> str:
    if not tests:
        return ""
    body = []
    for test in tests:
        interval = "&ndash;" if test["ci95"] is None else f"{test['ci95'][0]:+.3f} to {test['ci95'][1]:+.3f}"
        mean = "&ndash;" if test["mean_difference"] is None else f"{test['mean_difference']:+.3f}"
        body.append(
            f'<tr><th scope="row">{_e(test["setup"])}</th><td class="name">{_e(test["method"])}</td><td>{mean}</td>'
            f"<td>{interval}</td><td>{_p(test['p_value'])}</td><td>{_p(test['p_corrected'])}</td></tr>"
        )
    heads = _heads("setup", "method", "difference", "95 % interval", "p", "p (Holm)")
    return _table(f"Strict IoU minus that of {tests[0]['against']}", heads, body)


def _outcomes(rows: Sequence[Mapping[str, Any]]) -> str:
    timed = all("seconds_mean" in r for r in rows)
    body = []
    for r in rows:
        cells = [f"{r['cuts_mean']:.1f}", str(r["failures"]), str(r["stuck"]), str(r["dead_ends"])]
        cells += [f"{r['seconds_mean']:.2f}"] if timed else []
        numbers = "".join(f"<td>{cell}</td>" for cell in cells)
        body.append(f'<tr><th scope="row">{_e(r["setup"])}</th><td class="name">{_e(r["method"])}</td>{numbers}</tr>')
    heads = _heads("setup", "method", "cuts a trial", "failed", "stuck", "dead ends", *(["seconds a trial"] * timed))
    table = _table("Failed and stuck: runs of trials; dead ends: cuts planned from one", heads, body)
    return f"<details><summary>How the trials went</summary>{table}</details>"


def _pictures(pictures: Sequence[Picture]) -> str:
    if not pictures:
        return ""
    drawn = [
        f"<figure>{trial_picture(p.start, p.goal, p.reached, p.pairs)}<figcaption>{_e(p.title)}</figcaption></figure>"
        for p in pictures
    ]
    return (
        "<h2>What was reached</h2><p>Start, goal and what was reached. Fragments are drawn a little apart; those "
        "matched with one another have one colour, unmatched ones are grey.</p>" + "\n".join(drawn)
    )


def _worst(worst: Sequence[WorstTrial]) -> str:
    if not worst:
        return ""
    body = []
    for trial in worst:
        link = f' <a href="{_e(trial.recording)}">recording</a>' if trial.recording else ""
        body.append(
            f'<tr><th scope="row">{_e(trial.name)}</th><td>{trial.iou_strict:.3f}</td><td>{_e(trial.fragments)}</td>'
            f'<td class="name">{_e(trial.status)}{_e(": " + trial.reason if trial.reason else "")}</td>'
            f'<td class="name"><code>{_e(trial.command)}</code>{link}</td></tr>'
        )
    heads = _heads("trial", "strict IoU", "fragments", "how it ended", "to see it")
    return "<h2>The worst trials</h2>" + _table("Lowest strict IoU first", heads, body)


def _recordings(recordings: Sequence[tuple[str, str]]) -> str:
    if not recordings:
        return ""
    links = "".join(f'<li><a href="{_e(where)}">{_e(name)}</a></li>' for name, where in recordings)
    return f"<h2>Recordings</h2><p>For the rerun viewer.</p><ul>{links}</ul>"


def _provenance(provenance: Sequence[tuple[str, str]]) -> str:
    if not provenance:
        return ""
    body = [f'<tr><th scope="row">{_e(k)}</th><td class="name"><code>{_e(v)}</code></td></tr>' for k, v in provenance]
    return "<h2>Where the numbers come from</h2>" + _table("Runs, digests, settings, versions", "", body)


def _table(caption: str, heads: str, body: Sequence[str]) -> str:
    head = f"<thead><tr>{heads}</tr></thead>" if heads else ""
    rows = "\n".join(body)
    return f'<div class="wide"><table><caption>{_e(caption)}</caption>{head}<tbody>\n{rows}\n</tbody></table></div>'


def _heads(*names: str) -> str:
    words = ("setup", "method", "trial", "how it ended", "to see it")
    kinds = [' class="name"' if name in words else "" for name in names]
    return "".join(f'<th scope="col"{kind}>{_e(name)}</th>' for name, kind in zip(names, kinds, strict=True))


def _p(p: float | None) -> str:
    if p is None:
        return "&ndash;"
    return "&lt; 0.001" if p < 0.001 else f"{p:.3f}"


def _e(text: str) -> str:
    return html.escape(str(text), quote=True)


def _unique(names: Any) -> list[Any]:
    return list(dict.fromkeys(names))
