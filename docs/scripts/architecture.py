"""Draws the pictures of the architecture page from the code: the rooms with their imports, and one trial's path.

Run: python docs/scripts/architecture.py [FOLDER]       (or docs/pictures)

The rooms are the folders, and an arrow between two packages stands for imports that the code has. The path is read from
the stack while `evaluate` carries out one trial on the bench.
"""

import ast
import inspect
import sys
import tempfile
from collections import Counter
from html import escape
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent.parent
LEVELS = (("pipelines",), ("workers", "dashboards"), ("sim",), ("platform",))
"""The source folders from the highest to the lowest: each imports only from those below it."""
FILL = {"pipelines": "#e8eef9", "workers": "#f9efe0", "dashboards": "#f6e6ee", "sim": "#e5f4ea", "platform": "#e3f2f1"}
STYLE = "font-family='system-ui, sans-serif' fill='#1c2733'"


def package_of(folder: str) -> Path:
    """The one package in a source folder."""
    return next((ROOT / folder).glob("cutgrammar*"))


def rooms(folder: str) -> list[tuple[str, str, int]]:
    """(name, first line of its docstring, number of modules) of the sub-packages in a source folder, or its modules."""
    inits = sorted(package_of(folder).glob("*/__init__.py"))
    found = []
    for path in inits or sorted(package_of(folder).glob("[!_]*.py")):
        words = (ast.get_docstring(ast.parse(path.read_text())) or " ").splitlines()[0].replace("`", "")
        name, inside = (path.parent.name, path.parent.rglob("[!_]*.py")) if inits else (path.stem, [path])
        found.append((name, words, len(list(inside))))
    return found


def imports() -> Counter[tuple[str, str]]:
    """How many import statements lead from one source folder to another."""
    folders = {package_of(folder).name: folder for level in LEVELS for folder in level}
    found: Counter[tuple[str, str]] = Counter()
    for package, folder in folders.items():
        for path in (ROOT / folder / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.ImportFrom) and node.module:
                    target = folders.get(node.module.split(".")[0])
                    if target and target != folder:
                        found[folder, target] += 1
    return found


def text(x: float, y: float, words: str, size: int = 13, more: str = "") -> str:
    """A line of text."""
    return f"<text x='{x}' y='{y}' font-size='{size}' {STYLE} {more}>{escape(words)}</text>"


def whole(width: float, height: float, parts: list[str], label: str) -> str:
    """An SVG file of these parts."""
    head = f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width} {height}' role='img' aria-label='{label}'>"
    marker = (
        "<defs><marker id='head' viewBox='0 0 8 8' refX='7' refY='4' markerWidth='7' markerHeight='7'"
        " orient='auto'><path d='M0 0 8 4 0 8z' fill='#54606c'/></marker></defs>"
    )
    return "\n".join([head, marker, f"<rect width='{width}' height='{height}' fill='white'/>", *parts, "</svg>", ""])


def rooms_picture() -> str:
    """The source folders from high to low, with their sub-packages, and arrows along the imports."""
    width, row, gap, margin = 1000.0, 21.0, 52.0, 20.0
    parts, places, y = [], {}, margin
    for level in LEVELS:
        each = (width - 2 * margin - 30.0 * (len(level) - 1)) / len(level)
        height = 44.0 + row * max(len(rooms(folder)) or 1 for folder in level)
        for i, folder in enumerate(level):
            x = margin + i * (each + 30.0)
            places[folder] = (x, y, each, height)
            parts.append(f"<rect x='{x}' y='{y}' width='{each}' height='{height}' rx='8' fill='{FILL[folder]}'/>")
            parts.append(text(x + 14, y + 25, f"{folder}/{package_of(folder).name}", 15, "font-weight='700'"))
            for j, (name, words, modules) in enumerate(rooms(folder)):
                line = y + 50 + j * row
                limit = int((each - 180) / 6.3)
                words = words if len(words) <= limit else words[: limit - 1].rsplit(" ", 1)[0] + " …"
                parts.append(text(x + 14, line, name, 13, "font-weight='600'"))
                parts.append(text(x + 138, line, words, 12))
                parts.append(text(x + each - 12, line, str(modules), 12, "text-anchor='end' opacity='.6'"))
        y += height + gap
    arrows = imports()
    for number, ((source, target), count) in enumerate(sorted(arrows.items())):
        (xs, ys, ws, hs), (xt, yt, wt, _) = places[source], places[target]
        shift = (number % 5 - 2) * 34.0
        narrower = xs + ws / 2 if ws <= wt else xt + wt / 2
        x1 = x2 = narrower + shift
        y1, y2 = ys + hs, yt
        if y2 - y1 > gap + 1:  # passes a level: goes round it at the rim
            rim = width - 8.0 if x1 > width / 2 else 8.0
            inner = rim + (-12.0 if rim > width / 2 else 12.0)
            path = f"M{inner} {y1} L{rim} {y1 + 14} L{rim} {y2 - 14} L{inner + (-6 if rim > width / 2 else 6)} {y2}"
            label = None
        else:
            path, label = f"M{x1} {y1} L{x2} {y2}", (x1 + x2) / 2
        parts.append(f"<path d='{path}' fill='none' stroke='#54606c' stroke-width='1.6' marker-end='url(#head)'/>")
        if label is not None:
            parts.append(text(label + 5, (y1 + y2) / 2 + 4, str(count), 11, "opacity='.7'"))
    return whole(width, y - gap + margin, parts, "The five source folders, their rooms, and who imports whom")


def stacks() -> dict[str, list[tuple[str, str]]]:
    """(module, function) of every frame from `evaluate` to a cut planned, and to a cut made, innermost last."""
    from cutgrammar import FeatureSettings, InductionSettings, Settings
    from cutgrammar.methods import grammar
    from cutgrammar_pipelines import (
        CollectConfig,
        EvaluateConfig,
        SplitConfig,
        TrainConfig,
        collect,
        evaluate,
        split,
        train,
    )
    from cutgrammar_sim.worlds import division

    found: dict[str, list[tuple[str, str]]] = {}

    def watch(owner: Any, attribute: str, name: str) -> None:
        function = getattr(owner, attribute)

        def call(*arguments: Any, **named: Any) -> Any:
            if name not in found:
                frames = [(frame.frame.f_globals["__name__"], frame.function) for frame in inspect.stack()[1:]]
                inner = frames[: [function for _, function in frames].index("evaluate") + 1]
                found[name] = [*inner[::-1], (function.__module__, function.__qualname__)]
            return function(*arguments, **named)

        setattr(owner, attribute, call)

    settings = Settings(features=FeatureSettings(epochs=2), induction=InductionSettings(max_k=4, n_starts=1))
    with tempfile.TemporaryDirectory() as temporary:
        data, model, run = (Path(temporary) / name for name in ("data", "model", "run"))
        collect(CollectConfig(out=data, trials=12, workers=0, settings=settings))
        split(SplitConfig((data,), out=data))
        train(TrainConfig(data=data, out=model, settings=settings))
        watch(grammar, "search", "plan")
        watch(division, "slice_mesh", "cut")
        once = {"methods": ("grammar",), "setups": ("N1M1",), "runs": 1, "trials": 1, "world": "bench", "workers": 0}
        evaluate(EvaluateConfig(data=data, model=model, out=run, **once))
    return found


def path_picture() -> str:
    """The calls from `evaluate` to a plan made and to a cut made, one box a call, coloured by its source folder."""
    columns = stacks()
    folders = {package_of(folder).name: folder for level in LEVELS for folder in level}
    step, parts, tallest = 46.0, [], 0.0
    titles = {"plan": "until a cut is planned", "cut": "until a cut is made"}
    for i, (name, frames) in enumerate(sorted(columns.items(), reverse=True)):
        x = 20.0 + i * 490.0
        calls = [frame for frame in frames if not frame[1].startswith("<")]
        parts.append(text(x, 30, f"{titles[name]}: {len(calls)} calls", 15, "font-weight='700'"))
        for j, (module, function) in enumerate(calls):
            y = 46.0 + j * step
            fill = FILL.get(folders.get(module.split(".")[0], ""), "#eeeeee")
            parts.append(f"<rect x='{x}' y='{y}' width='470' height='34' rx='6' fill='{fill}'/>")
            parts.append(text(x + 12, y + 22, function, 13, "font-weight='600'"))
            parts.append(text(x + 458, y + 22, module, 11, "text-anchor='end' opacity='.75'"))
            if j:
                parts.append(
                    f"<path d='M{x + 24} {y - 12} L{x + 24} {y - 1}' stroke='#54606c' marker-end='url(#head)'/>"
                )
            tallest = max(tallest, y + 34.0)
    return whole(1000.0, tallest + 20.0, parts, "The calls of one trial, from evaluate to a cut planned and a cut made")


if __name__ == "__main__":
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "pictures"
    (out / "rooms.svg").write_text(rooms_picture())
    (out / "trial_path.svg").write_text(path_picture())
