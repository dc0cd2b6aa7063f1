"""mkdocs hook: writes the API reference from the stubs that list the public surface.

A line `<!-- exports of PACKAGE: PREFIX ... -->` in a page becomes the reference of all names that PACKAGE exports from
the modules whose names start with one of the prefixes; without prefixes, of all names.
"""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
MARK = re.compile(r"<!-- exports of (\w+):?([\w. ]*)-->")


def exports(package: str) -> list[tuple[str, str]]:
    """(module relative to the package, name) of everything that `package` exports, in the order of its stub."""
    stub = next(ROOT.glob(f"*/{package}/__init__.pyi"))
    nodes = [node for node in ast.parse(stub.read_text()).body if isinstance(node, ast.ImportFrom)]
    return [(node.module or "", alias.name) for node in nodes for alias in node.names if alias.name != "__version__"]


def reference(match: re.Match[str]) -> str:
    """The mkdocstrings directives for one mark."""
    package, prefixes = match[1], tuple(match[2].split())
    chosen = [(m, n) for m, n in exports(package) if not prefixes or m.startswith(prefixes)]
    if not chosen:
        raise ValueError(f"{match[0]} names nothing that {package} exports")
    return "\n\n".join(f"::: {package}.{module}.{name}" for module, name in chosen)


def on_page_markdown(markdown: str, **_: object) -> str:
    """Called by mkdocs for every page."""
    return MARK.sub(reference, markdown)
