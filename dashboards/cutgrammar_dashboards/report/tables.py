"""The tables of a report for one goals, world and perception: methods down, what they reached across."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cutgrammar_dashboards.report.html_parts import (
    UNKNOWN,
    escaped,
    folded,
    heads,
    interval,
    number,
    p_value,
    row,
    table,
)

Entry = Mapping[str, Any]
"""A row of one of the report's lists."""

SCORES = {
    "matched": "iou_mean",
    "refined": "iou_refined_mean",
    "spectral": "spectral_mean",
    "agreement": "agreement_mean",
}
"""Heading -> field of the scores beside strict IoU."""

CAPTIONS = {
    "matched": "Matched IoU, the paper's",
    "refined": "Refined IoU",
    "spectral": "Spectral distance (smaller is better)",
    "agreement": "Agreement of category and volume",
}

MEAN = "mean"
"""Heads the means over setups in Table I."""

SHOWN_MARK = " \N{DAGGER}"
"""Follows the name of a method that is shown the trial's own demonstration."""


Condition = tuple[str, str, str]
"""Goals, world, perception."""


@dataclass(frozen=True)
class Section:
    """What a report holds for one goals, world and perception.

    Attributes:
        rows, means, tests, improvement, profiles: its lists.
        shown: methods that are shown the trial's own demonstration.
    """

    rows: Sequence[Entry]
    means: Sequence[Entry]
    tests: Sequence[Entry]
    improvement: Sequence[Entry]
    profiles: Sequence[Entry]
    shown: Collection[str]

    @staticmethod
    def of(report: Mapping[str, Any], condition: Condition) -> "Section":
        """The section of `report` (as `build_report` made it) under `condition`."""
        rows, means, tests, improvement, profiles = (
            [entry for entry in report[name] if condition_of(entry) == condition]
            for name in ("rows", "setup_means", "tests", "improvement", "profiles")
        )
        return Section(rows, means, tests, improvement, profiles, report["shown"])

    @property
    def methods(self) -> list[str]:
        """In the order of the report."""
        return list(dict.fromkeys(r["method"] for r in self.rows))

    @property
    def setups(self) -> list[str]:
        """Without "all"."""
        return [setup for setup in dict.fromkeys(r["setup"] for r in self.rows) if setup != "all"]

    @property
    def cells(self) -> dict[tuple[str, str], Entry]:
        """(setup, method) -> row."""
        return {(r["setup"], r["method"]): r for r in self.rows}

    def named(self, method: str) -> str:
        """The method's name, marked where it is shown the demonstration."""
        return method + SHOWN_MARK * (method in self.shown)

    def kind(self, method: str) -> str:
        """Class of the method's rows: a line is drawn above the first that is shown the demonstration."""
        first = next((name for name in self.methods if name in self.shown), None)
        return "parted" if method == first and method != self.methods[0] else ""


def condition_of(entry: Entry) -> Condition:
    """Under which an entry of the report was reached."""
    return entry["goals"], entry["world"], entry["perception"]


def overview(section: Section) -> str:
    """Every method in one line: its scores over all setups and how its trials ended."""
    cells, means = section.cells, {one["method"]: one for one in section.means}
    known = {head: field for head, field in SCORES.items() if any(one[field] is not None for one in section.means)}
    body = []
    for method in section.methods:
        overall, mean = cells["all", method], means[method]
        line = [f'<td class="n">{overall["trials"]}</td>', _score(mean, "iou_strict"), _score(overall, "iou_strict")]
        line += [number(mean[field]) for field in known.values()]
        line += [_count(overall[name]) for name in ("failures", "stuck", "dead_ends")]
        body.append(row(section.named(method), line, section.kind(method)))
    columns = len(known)
    head = (
        '<tr><th></th><th></th><th colspan="2" class="group">strict IoU, mean over</th>'
        + (f'<th colspan="{columns}" class="group">mean of the setups</th>' if columns else "")
        + '<th colspan="3" class="group">how many</th></tr><tr>'
        + heads("method", "n", "setups", "trials", *known, "failed", "stuck", "dead ends")
        + "</tr>"
    )
    return table("All setups together", head, body)


def strict_by_setup(section: Section) -> str:
    """Strict IoU of every method in every setup."""
    return _by_setup(section, "Strict IoU, setup by setup", "iou_strict")


def beside_the_paper(section: Section, paper: Sequence[Entry]) -> str:
    """Table I: setups down; of each of the paper's methods what was reached here and what the paper prints."""
    methods = list(dict.fromkeys(one["method"] for one in paper))
    if not set(methods) & set(section.methods):
        return ""
    here = section.cells | {(MEAN, one["method"]): one for one in section.means}
    there: dict[tuple[str, str], Entry] = {(one["setup"], one["method"]): one for one in paper}
    there |= {(MEAN, method): _printed_mean(there, section.setups, method) for method in methods}
    body = []
    for setup in (*section.setups, MEAN):
        line = []
        for method in methods:
            if method in section.methods:
                line += [_brief(here.get((setup, method)), "iou_strict"), _brief(here.get((setup, method)), "iou")]
            line.append(f'<td class="paper">{_printed(there.get((setup, method)))}</td>')
        body.append(row(setup, line, "all" if setup == MEAN else ""))
    above, below = "", ""
    for method in methods:
        name = {"grammar": "grammar (the paper's Ours)"}.get(method, section.named(method))
        above += f'<th colspan="{3 if method in section.methods else 1}" class="group">{escaped(name)}</th>'
        below += '<th scope="col">strict</th><th scope="col">matched</th>' if method in section.methods else ""
        below += '<th scope="col" class="paper">paper</th>'
    head = f'<tr><th></th>{above}</tr><tr><th scope="col">setup</th>{below}</tr>'
    note = "The paper's numbers are from other foods, demonstrations and meshes: they do not compare one to one."
    return table("Table I: best-matched IoU here and as the paper prints it", head, body, note)


def against_reference(section: Section) -> str:
    """Every method against the reference method over all setups: difference, test, chance to be better."""
    tests = [test for test in section.tests if test["setup"] == "all"]
    if not tests:
        return ""
    reference = tests[0]["against"]
    wins = {one["over"]: one for one in section.improvement if one["setup"] == "all"}
    body = []
    for test in tests:
        win = wins[test["method"]]
        line = [f'<td class="n">{test["trials"]}</td>', number(test["mean_difference"], sign="+")]
        line += [interval(test["ci95"], "+"), p_value(test["p_value"]), p_value(test["p_corrected"])]
        line += [number(win["probability"]), interval(win["ci95"])]
        body.append(row(section.named(test["method"]), line, section.kind(test["method"])))
    head = heads(
        "method", "n", "difference", "95 % interval", "p", "p (Holm)", f"P({reference} above)", "95 % interval"
    )
    return table(f"Strict IoU against {reference}, trial by trial", head, body)


def against_reference_by_setup(section: Section) -> str:
    """The same for every setup by itself."""
    tests = [test for test in section.tests if test["setup"] != "all"]
    wins = {(one["setup"], one["over"]): one for one in section.improvement}
    body = []
    for test in tests:
        win = wins[test["setup"], test["method"]]
        line = [
            f'<td class="name">{escaped(section.named(test["method"]))}</td>',
            number(test["mean_difference"], sign="+"),
        ]
        line += [interval(test["ci95"], "+"), p_value(test["p_value"]), p_value(test["p_corrected"])]
        line += [number(win["probability"]), interval(win["ci95"])]
        body.append(row(test["setup"], line))
    if not body:
        return ""
    reference = tests[0]["against"]
    names = ("setup", "method", "difference", "95 % interval", "p", "p (Holm)", f"P({reference} above)")
    head = heads(*names, "95 % interval", words=("method",))
    return folded("Setup by setup", table(f"Strict IoU against {reference} in each setup", head, body))


def other_scores_by_setup(section: Section) -> str:
    """A table for every other score that is known."""
    tables = [
        _by_setup(section, CAPTIONS[name], field.removesuffix("_mean"))
        for name, field in SCORES.items()
        if any(r[field] is not None for r in section.rows)
    ]
    return folded("The other scores, setup by setup", "\n".join(tables))


def outcomes(section: Section) -> str:
    """How the trials went, cell by cell."""
    timed = all("seconds_mean" in r for r in section.rows)
    body = []
    for r in section.rows:
        line = [f'<td class="name">{escaped(section.named(r["method"]))}</td>', number(r["cuts_mean"], 1)]
        line += [_count(r[name]) for name in ("failures", "stuck", "dead_ends")]
        line += [number(r["seconds_mean"], 2)] if timed else []
        line += [f'<td class="name"><code>{r["digest"][:8]}</code></td>']
        body.append(row(r["setup"], line))
    names = (
        "setup",
        "method",
        "cuts a trial",
        "failed",
        "stuck",
        "dead ends",
        *(["seconds a trial"] * timed),
        "digest",
    )
    head = heads(*names, words=("method", "digest"))
    caption = "Failed and stuck: runs of trials; dead ends: cuts planned from one; digest: of all but times"
    return folded("How the trials went", table(caption, head, body))


def _by_setup(section: Section, caption: str, score: str) -> str:
    """Methods down, setups across; the means over setups and over trials at the end."""
    cells, means = section.cells, {one["method"]: one for one in section.means}
    columns = [*section.setups, "all"]
    body = []
    for method in section.methods:
        line = [_score(cells.get((setup, method)), score) for setup in section.setups]
        line += [_score(means[method], score, "mean"), _score(cells["all", method], score, "mean")]
        body.append(row(section.named(method), line, section.kind(method)))
    trials = {setup: max(r["trials"] for r in section.rows if r["setup"] == setup) for setup in columns}
    above = "".join(
        f'<th scope="col">{escaped(name)}</th>'
        for name in ("method", *section.setups, "mean of setups", "mean of trials")
    )
    below = "".join(f'<td class="n">{trials[setup]}</td>' for setup in section.setups)
    head = f'<tr>{above}</tr><tr class="n"><td>n</td>{below}<td></td><td class="n">{trials["all"]}</td></tr>'
    return table(caption, head, body)


def _score(entry: Entry | None, score: str, kind: str = "") -> str:
    """A mean, its spread over runs and its interval, where they are known."""
    opening = f'<td class="{kind}">' if kind else "<td>"
    if entry is None or entry[f"{score}_mean"] is None:
        return f"{opening}{UNKNOWN}</td>"
    spread, ends = entry.get(f"{score}_std_runs"), entry.get(f"{score}_ci95")
    text = number(entry[f"{score}_mean"]) + ("" if spread is None else f" <small>&plusmn; {spread:.3f}</small>")
    return f"{opening}{text}{'' if ends is None else f'<br><small>{interval(ends)}</small>'}</td>"


def _brief(entry: Entry | None, score: str) -> str:
    """A mean and, below it, its spread over runs."""
    if entry is None or entry[f"{score}_mean"] is None:
        return UNKNOWN
    spread = entry.get(f"{score}_std_runs")
    return number(entry[f"{score}_mean"]) + ("" if spread is None else f"<br><small>&plusmn; {spread:.3f}</small>")


def _printed(entry: Entry | None) -> str:
    """What the paper prints, with its two digits."""
    if entry is None or entry["iou_mean"] is None:
        return UNKNOWN
    spread = entry["iou_std"]
    return f"{entry['iou_mean']:.2f}" + ("" if spread is None else f"<br><small>&plusmn; {spread:.2f}</small>")


def _printed_mean(printed: Mapping[tuple[str, str], Entry], setups: Sequence[str], method: str) -> Entry:
    """The mean over setups of what the paper prints; unknown unless it prints all of them."""
    values = [printed[setup, method]["iou_mean"] for setup in setups if (setup, method) in printed]
    known = len(values) == len(setups) > 0
    return {"iou_mean": sum(values) / len(values) if known else None, "iou_std": None}


def _count(count: int) -> str:
    """A count; none is quiet."""
    return str(count) if count else '<td class="n">0</td>'
