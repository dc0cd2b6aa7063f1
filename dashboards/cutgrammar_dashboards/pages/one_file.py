"""Modules of JavaScript as one script without imports, for a page that is a single file and loads nothing."""

import base64
import hashlib
import re
from collections.abc import Mapping, Sequence

IMPORT = re.compile(r'^import \{([^}]*)\} from "\./([^"]+)";\n', re.MULTILINE)
EXPORTS = re.compile(r"\bexport\s*\{([^}]*)\};?")
"""A list of exports, as minified modules have at their end."""
EXPORT = re.compile(r"^export (class|function|const) (\w+)", re.MULTILINE)
SOURCE_MAP = re.compile(r"^//# sourceMappingURL=.*$", re.MULTILINE)


def one_script(contents: Mapping[str, bytes], names: Sequence[str]) -> str:
    """A script that contains these modules, each in a function of its own that returns what it exports.

    Modules may import names from those before them, as `import { A, B } from "./name.js";`, and export a list of names,
    or classes, functions and constants where they are declared.

    Args:
        contents: name -> the module as UTF-8; other files are ignored.
        names: of the modules, in the order in which they depend on one another; the last one is the page's own.

    Raises:
        ValueError: a module imports one that is not before it, or in another way.
    """
    parts = ["const modules = {};"]
    for number, name in enumerate(names):
        text = SOURCE_MAP.sub("", contents[name].decode())
        for _, imported in IMPORT.findall(text):
            if imported not in names[:number]:
                raise ValueError(f"{name} imports {imported}, which must be one of {', '.join(names[:number])}")
        text = IMPORT.sub(lambda found: f"const {{{found[1]}}} = modules[{found[2]!r}];\n", text)
        exported = [pair for found in EXPORTS.findall(text) for pair in _pairs(found)]
        exported += [(name, name) for _, name in EXPORT.findall(text)]
        text = EXPORT.sub(r"\1 \2", EXPORTS.sub("", text))
        if re.search(r"^\s*(import|export)\b", text, re.MULTILINE):
            raise ValueError(f"{name} imports or exports in a way that cannot be put into one script")
        result = ", ".join(f"{public}: {own}" for own, public in exported)
        parts.append(f"modules[{name!r}] = (() => {{\n{text}\nreturn {{ {result} }};\n}})();")
    return _harmless("\n".join(parts))


def source_of(script: str) -> str:
    """The source of an inline script as a content security policy names it: its digest."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"


def _pairs(exports: str) -> list[tuple[str, str]]:
    """(own name, exported name), ... of a list of exports."""
    names = [item.split(" as ") for item in exports.split(",") if item.strip()]
    return [(pair[0].strip(), pair[-1].strip()) for pair in names]


def _harmless(script: str) -> str:
    """The script without what would end its element or begin a comment in it; such letters are in texts only."""
    return re.sub(r"<(?=/script|!--)", r"<\\", script, flags=re.IGNORECASE)
