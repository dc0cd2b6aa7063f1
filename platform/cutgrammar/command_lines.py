"""Commands as a user can type them: with the path of the program where the shell would not find it, or find another."""

import os
import re
import shlex
import shutil
import sys
import sysconfig
from pathlib import Path

PROGRAM = "cutgrammar"
COMMANDS = (
    *("collect", "import", "record", "split", "train", "evaluate", "rate", "plan"),
    *("report", "view", "film", "export", "show", "sync", "study", "mlflow", "doctor"),
)
_IN_PROSE = re.compile(rf"(?<![\w./\\'-]){PROGRAM} (?=(?:{'|'.join(COMMANDS)}|--help)\b)")


def command_line(*words: object) -> str:
    """The command `cutgrammar WORDS`, quoted for a shell.

    Example:
        >>> command_line("view", Path("my run"), "N1M1-0")  # after `make demo`  # doctest: +SKIP
        ".venv/bin/cutgrammar view 'my run' N1M1-0"
    """
    return f"{program()} {shlex.join(map(str, words))}"


def as_typed(text: str) -> str:
    """A message whose commands, such as "cutgrammar collect", a user can type as they are printed."""
    return _IN_PROSE.sub(lambda _: f"{program()} ", text) if PROGRAM in text else text


def program(name: str = PROGRAM) -> str:
    """What starts an installed program from the current folder, quoted for a shell.

    Its name where the PATH has it; otherwise its path, relative if it is in the current folder.

    Args:
        name: of a program that is installed beside this one.
    """
    folder = _folder()
    script = shutil.which(name, path=str(folder))
    if script is None:  # run from the sources
        return f"{shlex.quote(sys.executable)} -m cutgrammar_pipelines" if name == PROGRAM else name
    found = shutil.which(name)
    if found is not None and os.path.samefile(found, script):
        return name
    path, here = Path(os.path.abspath(script)), Path.cwd()
    return shlex.quote(str(path.relative_to(here) if path.is_relative_to(here) else path))


def _folder() -> Path:
    """The folder of the program that runs or, in another program such as a test, of this environment's programs."""
    started = Path(sys.argv[0])
    return started.parent if started.stem == PROGRAM and started.is_file() else Path(sysconfig.get_path("scripts"))
