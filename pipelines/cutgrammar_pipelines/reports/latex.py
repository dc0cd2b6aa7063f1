"""A report as LaTeX: the tables that its text has, for a paper; figures, details and the glossary are left out."""

import re
from collections.abc import Iterator, Sequence
from itertools import groupby

from cutgrammar.results.report import Cell, Column, Report, Table

HEAD = "% Needs \\usepackage{booktabs}. Wide tables fit with \\resizebox{\\linewidth}{!}{...} around the tabular.\n"
ESCAPED = str.maketrans(
    {
        **{sign: f"\\{sign}" for sign in "&%$#_{}"},
        "\\": "\\textbackslash{}",
        "~": "\\textasciitilde{}",
        "^": "\\textasciicircum{}",
        "<": "$<$",
        ">": "$>$",
        "±": "$\\pm$",
        "↓": "$\\downarrow$",
        "†": "\\dag{}",
        "‡": "\\ddag{}",
        "§": "\\S{}",
        "–": "--",
    }
)


def as_latex(report: Report) -> str:
    """The tables of the report as `table` environments with booktabs' rules, captioned with section, title and note."""
    parts = [f"% {report.title}\n{HEAD}"]
    for section in report.sections:
        shown = [item for item in section.items if isinstance(item, Table) and not item.fold]
        heading = ", ".join(filter(None, (section.title, section.subtitle)))
        parts += [] if section.is_detail else [_table(table, heading) for table in shown]
    return "\n".join(parts)


def _table(table: Table, heading: str) -> str:
    caption = ". ".join(text.rstrip(".") for text in (heading, table.title, table.note) if text) + "."
    lines = ["\\begin{table}", "  \\centering", f"  \\caption{{{_escaped(caption)}}}"]
    lines += [
        f"  \\begin{{tabular}}{{{''.join('l' if c.holds_words else 'r' for c in table.columns)}}}",
        "    \\toprule",
    ]
    lines += [f"    {line}" for line in _heads(table.columns)] + ["    \\midrule"]
    for row in table.rows:
        lines += ["    \\midrule"] if row.kind in ("total", "apart") else []
        lines.append(f"    {_line([_cell(cell) for cell in row.cells])}")
    return "\n".join([*lines, "    \\bottomrule", "  \\end{tabular}", "\\end{table}", ""])


def _heads(columns: Sequence[Column]) -> Iterator[str]:
    """The line of the groups with a rule under each, if there are groups, and that of the headings."""
    if any(column.group for column in columns):
        groups, rules, first = [], [], 1
        for group, neighbours in groupby(columns, lambda column: column.group):
            last = first + len(list(neighbours)) - 1
            if group:
                groups.append(f"\\multicolumn{{{last - first + 1}}}{{c}}{{{_escaped(group)}}}")
                rules.append(f"\\cmidrule(lr){{{first}-{last}}}")
            else:
                groups += [""] * (last - first + 1)
            first = last + 1
        yield _line(groups)
        yield "".join(rules)
    yield _line([_escaped(column.heading) for column in columns])


def _line(cells: Sequence[str]) -> str:
    return f"{' & '.join(cells)} \\\\"


def _cell(cell: Cell) -> str:
    """The cell as text prints it; a hyphen before a number is a minus."""
    text = _escaped(cell.text)
    return text if isinstance(cell.value, str) else re.sub(r"(?<!\S)-(?=\d)", "$-$", text)


def _escaped(text: str) -> str:
    return text.translate(ESCAPED)
