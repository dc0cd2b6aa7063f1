"""The command line, `cutgrammar COMMAND`: what it answers when something goes wrong.

Exit codes: 0 all is there (failures of trials allowed, and printed), 1 incomplete, 2 bad input with one clear line,
130 interrupted and resumable.
"""

import argparse
import os
import sys
from collections.abc import Sequence

from cutgrammar.errors import InputError
from cutgrammar_pipelines.cli.commands import build_parser
from cutgrammar_pipelines.cli.options import Handler

WRONG_PLACE = (FileNotFoundError, FileExistsError, NotADirectoryError, IsADirectoryError, PermissionError)
"""What the system raises at places that were named wrongly: bad input, while a full disk leaves work incomplete."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # one torch thread a worker; before anything imports torch
    parser = build_parser()
    chosen, unknown = parser.parse_known_args(arguments)
    if unknown:
        chosen.parser.error(f"unknown option {unknown[0]}{chosen.parser.closest_to(unknown[0])}")
    handler: Handler = chosen.handler
    try:
        return handler(chosen)
    except InputError as error:
        print(f"{parser.prog} {chosen.command}: {error}", file=sys.stderr)
        return 2
    except OSError as error:  # a full disk, a folder that may not be written: nothing written before is lost
        print(f"{parser.prog} {chosen.command}: {_told(error, chosen)}", file=sys.stderr)
        return 2 if isinstance(error, WRONG_PLACE) else 1
    except KeyboardInterrupt:
        print(
            f"{parser.prog} {chosen.command}: interrupted; give the same command again: {_again(chosen)}",
            file=sys.stderr,
        )
        return 130


def _told(error: OSError, chosen: argparse.Namespace) -> str:
    """What the system said, of which file (where it named none, the place that is written to), and what to try."""
    place = error.filename2 or error.filename or getattr(chosen, "out", None)
    what = str(error) if error.errno is None or place is None else f"{place}: {os.strerror(error.errno)}"
    if isinstance(error, WRONG_PLACE):
        return f"{what}; choose another place"
    return f"{what}; mend it and give the same command again: {_again(chosen)}"


def _again(chosen: argparse.Namespace) -> str:
    """What the same command does after it was broken off."""
    return "it goes on from here" if chosen.command in ("evaluate", "study") else "it begins anew, nothing is half done"


if __name__ == "__main__":
    sys.exit(main())
