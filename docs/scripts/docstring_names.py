"""griffe extension: an entry of a docstring that names several things becomes one entry for each.

`width, height: of its images [pixels].` is one line in the source. griffe expects one name in each entry; it would take
the other names for a type.
"""

import re
from typing import Any

import griffe

ENTRY = re.compile(r"^(?P<indent> +)(?P<names>\w+(?:, \w+)+): (?P<text>.*(?:\n(?P=indent) +.*)*)", re.MULTILINE)


def names_apart(docstring: str) -> str:
    """The docstring with one name in each entry.

    Example:
        >>> print(names_apart("Size.\\n\\nArgs:\\n    width, height: in pixels."))
        Size.
        <BLANKLINE>
        Args:
            width: in pixels.
            height: in pixels.
    """
    return ENTRY.sub(
        lambda m: "\n".join(f"{m['indent']}{name}: {m['text']}" for name in m["names"].split(", ")), docstring
    )


class NamesApart(griffe.Extension):
    """Rewrites every docstring when its object is loaded."""

    def on_instance(self, *, obj: griffe.Object | griffe.Alias, **_: Any) -> None:
        """Called by griffe for every object."""
        if obj.docstring is not None:
            obj.docstring.value = names_apart(obj.docstring.value)
