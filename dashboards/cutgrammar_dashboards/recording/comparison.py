"""One recording that shows the recordings of several trials beside one another.

Recordings are untrusted, and rerun can end the process that reads one, so a process of its own reads them
(`comparison_process`).
"""

import json
import re
import tempfile
from collections.abc import Mapping
from pathlib import Path

from cutgrammar.atomic_files import put_in_place
from cutgrammar.errors import InputError
from cutgrammar.untrusted.parser_processes import REFUSED, run_parser


def write_side_by_side(recordings: Mapping[str, Path], title: str, out: Path) -> None:
    """Write one recording with a column for each of `recordings`, whole or not at all.

    All columns follow one timeline: `step`, the number of cuts made.

    Args:
        recordings: name of a column -> file that a `Recorder` wrote.
        title: name of the new recording.
        out: file to write; its folder is created.

    Raises:
        InputError: a file is no recording or too large, or two names differ in punctuation only.
    """
    places = {name: re.sub(r"[^A-Za-z0-9]+", "_", name) for name in recordings}
    if len(set(places.values())) < len(places):
        raise InputError(f"{', '.join(recordings)} cannot be told apart in a recording; compare others")
    out.parent.mkdir(parents=True, exist_ok=True)
    columns = [(name, places[name], str(file.absolute())) for name, file in recordings.items()]
    with tempfile.TemporaryDirectory(dir=out.parent) as folder:
        partial = Path(folder).absolute() / "comparison.rrd"
        given = json.dumps({"title": title, "columns": columns, "out": str(partial)})
        answer = run_parser("cutgrammar_dashboards.recording.comparison_process", (), given.encode())
        if answer.code == REFUSED:
            raise InputError(f"{answer.message}; record the trial again")
        if answer.code != 0:
            files = " and ".join(map(str, recordings.values()))
            raise InputError(f"{files} cannot be read ({answer.reason}); record the trials again")
        put_in_place(partial, out)
