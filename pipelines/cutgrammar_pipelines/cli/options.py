"""What the options of several commands share: a parser whose errors are one line, numbers, seeds, workers, settings."""

import argparse
import difflib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from cutgrammar.settings import Settings, load_settings

Handler = Callable[[argparse.Namespace], int]
"""Carries out a command and returns its exit code."""


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line and whose help keeps its paragraphs."""

    def __init__(self, **options: Any) -> None:
        options.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        super().__init__(allow_abbrev=False, **options)

    def error(self, message: str) -> NoReturn:
        """Print one line and exit with code 2."""
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")

    def closest_to(self, word: str) -> str:
        """A question after the option that was meant, if one is close."""
        known = [option for action in self._actions for option in action.option_strings]
        close = difflib.get_close_matches(word.split("=")[0], known, 1)
        return f"; did you mean {close[0]}?" if close else ""


def whole_number(least: int) -> Callable[[str], int]:
    """A type of option: whole numbers from `least`."""

    def read(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from None
        if value < least:
            raise argparse.ArgumentTypeError(f"{text} is too small; {least} is the least")
        return value

    return read


def computes(parser: argparse.ArgumentParser, distributed: bool = True) -> None:
    """Add the options of all commands that compute; those that are not distributed take `--workers` without effect."""
    group = parser.add_argument_group("computing")
    group.add_argument(
        "--seed",
        type=whole_number(0),
        default=0,
        help="all randomness follows from it: same seed, same result (default 0)",
    )
    group.add_argument(
        "--settings", type=Path, metavar="FILE.toml", help="change knobs: one table a room, e.g. [search] rounds = 100"
    )
    if not distributed:
        none_needed = "taken for the sake of scripts: this command works in one process"
        group.add_argument("--workers", type=whole_number(0), metavar="N", help=none_needed)
        group.add_argument("--address", metavar="ADDRESS", help=none_needed)
        return
    group.add_argument(
        "--workers",
        type=whole_number(0),
        default=os.cpu_count() or 1,
        metavar="N",
        help="Ray actors to use; 0 works in this process without Ray; never changes a result (default: all cores)",
    )
    group.add_argument(
        "--address", metavar="ADDRESS", help="join a running Ray cluster, e.g. auto; without it a local Ray is started"
    )


def allow_missing(parser: argparse.ArgumentParser) -> None:
    """Add `--allow-missing`."""
    parser.add_argument(
        "--allow-missing", action="store_true", help="go on without parts of the data set that are missing or torn"
    )


def add_command(commands: Any, name: str, handler: Handler, summary: str, text: str = "") -> argparse.ArgumentParser:
    """Add a command: its name, what carries it out, one line and further help."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=summary, description=f"{summary}\n\n{text}".strip()
    )
    parser.set_defaults(handler=handler, parser=parser)
    return parser


def settings_of(chosen: argparse.Namespace) -> Settings:
    """The settings that `--settings` asks for."""
    return load_settings(chosen.settings)
