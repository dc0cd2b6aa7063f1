"""What a page is built of: escaped words, numbers as they are printed, tables, and the page around it all."""

import html
from collections.abc import Sequence
from importlib.resources import files

UNKNOWN = "&ndash;"
"""Stands for a number that is not known."""


def escaped(text: object) -> str:
    """`text` as it may stand in a page or an attribute."""
    return html.escape(str(text), quote=True)


def number(value: float | None, digits: int = 3, sign: str = "") -> str:
    """E.g. "0.532"; `sign` "+" shows a plus too."""
    return UNKNOWN if value is None else f"{value:{sign}.{digits}f}"


def interval(ends: Sequence[float] | None, sign: str = "") -> str:
    """E.g. "0.412 to 0.598"."""
    return UNKNOWN if ends is None else f"{ends[0]:{sign}.3f} to {ends[1]:{sign}.3f}"


def p_value(p: float | None) -> str:
    """E.g. "0.031"."""
    if p is None:
        return UNKNOWN
    return "&lt; 0.001" if p < 0.001 else f"{p:.3f}"


def heads(*names: str, words: Sequence[str] = ()) -> str:
    """A row of headings; those in `words`, and the first, stand over words and not over numbers."""
    kinds = [' class="name"' if name in words else "" for name in names]
    return "".join(f'<th scope="col"{kind}>{escaped(name)}</th>' for name, kind in zip(names, kinds, strict=True))


def row(name: str, cells: Sequence[str], kind: str = "") -> str:
    """A row of a table: its name and its cells, which are escaped already."""
    body = "".join(cell if cell.startswith("<td") else f"<td>{cell}</td>" for cell in cells)
    return f'<tr{f" class={kind}" if kind else ""}><th scope="row">{escaped(name)}</th>{body}</tr>'


def table(caption: str, head: str, body: Sequence[str], note: str = "") -> str:
    """A table that scrolls sideways by itself where the page is too narrow.

    Args:
        caption: what it shows.
        head: the row of headings (or several `<tr>`), "" for none.
        body: its rows.
        note: said below the caption in small letters.
    """
    above = f"<thead>{head if head.startswith('<tr') else f'<tr>{head}</tr>'}</thead>" if head else ""
    said = f"<br><small>{escaped(note)}</small>" if note else ""
    rows = "\n".join(body)
    return (
        f'<div class="wide"><table><caption>{escaped(caption)}{said}</caption>{above}<tbody>\n{rows}\n'
        "</tbody></table></div>"
    )


def folded(summary: str, content: str) -> str:
    """What is shown when one asks for it; nothing where there is nothing."""
    return f"<details><summary>{escaped(summary)}</summary>\n{content}\n</details>" if content else ""


def whole_page(title: str, parts: Sequence[str]) -> str:
    """The page around its parts: it carries its own style and asks nothing of the network."""
    style = (files("cutgrammar_dashboards") / "report_page.css").read_text()
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
        "img-src data:; style-src 'unsafe-inline'\">"
        f"<title>{escaped(title)}</title><style>{style}</style></head>\n<body><main>\n"
        + "\n".join(part for part in parts if part)
        + "\n</main></body></html>\n"
    )
