"""What is installed under an entry-point group, with a line on each.

Descriptions are read from the source code where possible: importing all methods and worlds would take seconds.
"""

import ast
import shutil
import textwrap
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from cutgrammar.errors import InputError
from cutgrammar.plugins import load, references_in

TEXTS = ("description", "help")
"""The fields of a `Method` or a `Score` that describe it; written without a name, it is the third argument."""


def list_installed(group: str) -> str:
    """A heading and one line for each name in an entry-point group."""
    references = references_in(group)
    indent = 4 + max(map(len, references), default=0)
    columns = max(shutil.get_terminal_size().columns, indent + 40)
    lines = [f"Installed {group.removeprefix('cutgrammar.')}:"]
    for name, reference in references.items():
        first = f"  {name}".ljust(indent)
        text = describe(reference)
        lines.append(textwrap.fill(text, columns, initial_indent=first, subsequent_indent=" " * indent) or first)
    return "\n".join(lines)


def describe(reference: str) -> str:
    """The first sentence of the description, help or docstring of the object that "module:attribute" names."""
    module, _, attribute = reference.partition(":")
    text = _in_source(module, attribute)
    if text is None:
        try:
            thing = load(reference)
        except InputError as error:
            return str(error)
        text = next(filter(None, (getattr(thing, name, None) for name in (*TEXTS, "__doc__"))), "")
    return " ".join(text.split("\n\n")[0].split()).partition(". ")[0].removesuffix(".")


def _in_source(module: str, attribute: str) -> str | None:
    """The description as written in the source; None if the code must run to give it."""
    spec = find_spec(module)
    for node in _statements(str(spec and spec.origin)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == attribute:
            return ast.get_docstring(node)
        if isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == attribute for t in node.targets):
            call = node.value if isinstance(node.value, ast.Call) else None
            texts = [word.value for word in call.keywords if word.arg in TEXTS] or call.args[2:3] if call else []
            if texts and isinstance(texts[0], ast.Constant) and isinstance(texts[0].value, str):
                return texts[0].value
    return None


@cache
def _statements(file: str) -> list[ast.stmt]:
    """The statements of a source file; none if it cannot be read."""
    try:
        return ast.parse(Path(file).read_text()).body
    except (OSError, SyntaxError, UnicodeDecodeError):
        return []
