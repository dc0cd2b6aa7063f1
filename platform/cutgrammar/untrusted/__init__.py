"""The edge of the platform: files, texts and numbers of strangers, checked before anything else sees them.

A file is opened in one place (`files`), JSON and TOML are parsed in one place (`documents`) with limits on size,
nesting and numbers, plain data are checked against one schema for each reader (`schemas`, `kinds`), memory is bounded
where a library decompresses (`memory`, `archives`), and text is made printable in one place (`printing`).
"""

from cutgrammar.untrusted.documents import parse_json, parse_toml, read_json
from cutgrammar.untrusted.files import check_regular, read_regular
from cutgrammar.untrusted.printing import one_line, printable, shortened
from cutgrammar.untrusted.schemas import check

__all__ = [
    "check",
    "check_regular",
    "one_line",
    "parse_json",
    "parse_toml",
    "printable",
    "read_json",
    "read_regular",
    "shortened",
]
