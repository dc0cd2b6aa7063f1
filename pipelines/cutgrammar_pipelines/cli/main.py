"""The entry point `cutgrammar COMMAND`: it runs one command and turns errors into one line and an exit code.

Exit codes: 0 everything is there (failed trials are allowed, and printed), 1 incomplete, 2 bad input with one clear
line, 130 interrupted with Ctrl-C, 143 ended by SIGTERM (the same command resumes it), 141 whoever read the output has
gone.
"""

import gc
import os
import shlex
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from cyclopts import CycloptsError
from cyclopts.exceptions import MissingArgumentError, UnusedCliTokensError
from pydantic import ValidationError

from cutgrammar.command_lines import as_typed
from cutgrammar.errors import InputError
from cutgrammar.settings import in_one_line
from cutgrammar.untrusted import one_line
from cutgrammar.untrusted.printing import printing_safely
from cutgrammar_pipelines.cli.app import build_app, help_epilogue
from cutgrammar_pipelines.cli.closed_output import CODE, silence_closed_output
from cutgrammar_pipelines.cli.commands import COMMANDS
from cutgrammar_pipelines.cli.termination import terminable
from cutgrammar_workers.one_thread import ONE_THREAD

HELP = ("--help", "-h")
QUIET = "--quiet"
"""The option that every command takes: only results and problems are printed."""
WRONG_PLACE = (FileNotFoundError, FileExistsError, NotADirectoryError, IsADirectoryError, PermissionError)
"""What the system raises for a wrong path, which is bad input; a full disk, in contrast, leaves work incomplete."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    try:
        code = _interruptible(arguments)
        _flush()
        return code
    except (BrokenPipeError, SystemExit) as error:  # the latter is how rich, which prints help, ends a program
        if isinstance(error.__context__, BrokenPipeError) or silence_closed_output():
            return CODE
        raise


def _interruptible(arguments: Sequence[str] | None) -> int:
    os.environ.update(ONE_THREAD)  # as in workers, whatever a scheduler has set; before anything imports numpy
    given = list(sys.argv[1:] if arguments is None else arguments)
    words = [word for word in given if word != QUIET]
    with terminable() as is_terminated:
        try:
            if len(words) == len(given):
                return _run(words)
            from cutgrammar_pipelines.stages.progress import quietly

            with quietly():
                return _run(words)
        except KeyboardInterrupt:
            ended, code = ("terminated", 143) if is_terminated() else ("interrupted", 130)
            name = given[0] if given else ""
            again = f"{_on_restart(name)}: {shlex.join(['cutgrammar', *given])}"
            _refuse(f"cutgrammar {name}", f"{ended}; run the same command again, {again}")
            return code


def _run(words: list[str]) -> int:
    if not words:
        return _refuse("cutgrammar", "a command is required, e.g. cutgrammar collect (see cutgrammar --help)")
    app = build_app(words[0])
    program = f"cutgrammar {words[0]}"
    if words[0] in COMMANDS and any(word in HELP for word in words):
        app[words[0]].help_epilogue = help_epilogue(words[0])
        app.help_print(words[0])
        return 0
    gc.enable()
    try:
        with _printing(words):
            code = app(words, exit_on_error=False, print_error=False, help_on_error=False)
        _flush()
        return code if isinstance(code, int) else 0
    except CycloptsError as error:
        chain = " ".join(["cutgrammar", *(error.command_chain or ())])
        return _refuse(chain, f"{_explained(error)} (see {chain} --help)")
    except InputError as error:
        return _refuse(program, str(error))
    except OSError as error:  # a full disk, a folder that may not be written: nothing written before is lost
        if isinstance(error, BrokenPipeError) and silence_closed_output():
            return CODE
        _refuse(program, _system_error(error, words))
        return 2 if isinstance(error, WRONG_PLACE) else 1


def _printing(words: Sequence[str]) -> AbstractContextManager[None]:
    """What a command prints has no control characters; help, which has colours, is no stranger's."""
    return printing_safely(sys.stdout, sys.stderr) if words[0] in COMMANDS else nullcontext()


def _flush() -> None:
    """Write what is buffered, so that an error of the system is met here and not when Python exits."""
    if sys.stdout is not None:  # as after >&-
        sys.stdout.flush()


def _refuse(program: str, message: str) -> int:
    print(f"{program}: {one_line(as_typed(message))}", file=sys.stderr)
    return 2


def _explained(error: CycloptsError) -> str:
    """What is wrong with the words of a command, in one line."""
    if isinstance(error, MissingArgumentError) and (missing := error.argument) is not None:
        if error.keyword:
            return f"{missing.name} needs a value"
        return f"{missing.name if missing.index is None else missing.name.strip('-').upper()} is missing"
    cause: Any = error.__cause__
    if isinstance(cause, ValidationError):
        return in_one_line(cause, type(cause), option=True)
    if isinstance(error, UnusedCliTokensError):
        return f"unexpected argument {' '.join(error.unused_tokens or ())}"
    return " ".join(str(error).split())


def _system_error(error: OSError, words: Sequence[str]) -> str:
    """What the system reports, about which path (the one that is written to if it names none), and what to try."""
    out = words[words.index("--out") + 1] if "--out" in words[:-1] else None
    place = error.filename2 or error.filename or out
    what = str(error) if error.errno is None or place is None else f"{place}: {os.strerror(error.errno)}"
    if isinstance(error, WRONG_PLACE):
        return f"{what}; choose another place"
    return f"{what}; correct this and run the same command again: {_on_restart(words[0])}"


def _on_restart(command: str) -> str:
    """What a command does when it is run again after an interruption."""
    return (
        "it resumes"
        if command in ("collect", "evaluate", "rate", "record", "study")
        else "it starts from the beginning, nothing is half done"
    )
