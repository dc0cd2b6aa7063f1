"""The command-line application: help texts from the configs, and the list of what is installed."""

import inspect
from collections.abc import Callable
from typing import Any, get_args, get_type_hints

from cyclopts import App, Parameter
from cyclopts.help import DefaultFormatter, HelpEntry, HelpPanel
from cyclopts.help.inline_text import InlineText
from rich.console import Console, ConsoleOptions

from cutgrammar.command_lines import as_typed
from cutgrammar.plugins import FOODS, METHODS, SCORES, WORLDS
from cutgrammar_pipelines.cli.commands import COMMANDS
from cutgrammar_pipelines.cli.installed import list_installed

OVERVIEW = """\
Plan how to cut objects into desired fragments with a learned stochastic grammar, and measure how well it works.

The usual order of commands:
  cutgrammar collect  --out data
  cutgrammar split    data --out data
  cutgrammar train    --data data --out model
  cutgrammar evaluate --data data --model model --out run
  cutgrammar report   run --out report.html
  cutgrammar view     run
  cutgrammar film     run TRIAL
  cutgrammar export   run TRIAL --out trajectories

All of these steps from one settings file:
  cutgrammar study    --preset demo --out demo

Every command takes --quiet: no progress, status or notes, only results and problems.
cutgrammar --install-completion has your shell complete commands and options."""
COMPLETION = "--install-completion"
INSTALLED = {
    "collect": (FOODS,),
    "record": (FOODS,),
    "evaluate": (METHODS, WORLDS, SCORES),
    "plan": (METHODS,),
    "report": (SCORES,),
}
"""The entry-point groups that the help of a command lists."""


class Reflowed(DefaultFormatter):
    """Help in which the lines of a field's docstring are joined, and so break where the terminal ends only."""

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Print a panel of options or commands."""
        super().__call__(console, options, panel.copy(entries=list(map(_reflowed, panel.entries))))


def _reflowed(entry: HelpEntry) -> HelpEntry:
    if not isinstance(entry.description, InlineText):
        return entry
    text = " ".join(str(entry.description.primary_renderable).split())
    return entry.copy(description=InlineText.from_format(text, "plaintext"))


def build_app(command: str) -> App:
    """The application with one command, or with all if there is none of this name.

    Registering a command imports its config, which takes some milliseconds.
    """
    app = App(
        name="cutgrammar",
        help=as_typed(OVERVIEW),
        version=_version,
        help_format="plaintext",
        help_formatter=Reflowed(),
        result_action="return_value",
        suppress_keyboard_interrupt=False,
        default_parameter=Parameter(
            negative=(), consume_multiple=True, allow_repeating=True, show_default=_default_text, show_env_var=False
        ),
    )
    for position, name in enumerate([command] if command in COMMANDS else COMMANDS):
        app.command(COMMANDS[name], name=name, help=_help_of(COMMANDS[name]), sort_key=position)
    if command == COMPLETION:
        app.register_install_completion_command(COMPLETION)
    return app


def help_epilogue(command: str) -> str:
    """What the help of a command says about installed methods, worlds, scores or foods."""
    installed = [list_installed(group) for group in INSTALLED.get(command, ())]
    return "\n\n".join([*installed, "With --quiet, only results and problems are printed."])


def _help_of(command: Callable[..., int]) -> str:
    """The docstring of a command's config, without its fields; of a command without options, its own docstring."""
    hint = get_type_hints(command, include_extras=True).get("config")
    config = get_args(hint)[0] if hint else command
    text = (inspect.getdoc(next(iter(get_args(config)), config)) or "").partition("\nAttributes:")[0].strip()
    paragraphs = text.replace("Example:\n", "For example:\n").split("\n\n")
    whole = (" ".join(words.split("\n")) if "\n  " not in words else words for words in paragraphs)
    return as_typed("\n\n".join(whole))


def _default_text(default: Any) -> str | None:
    """A default value as help shows it."""
    if default is None or default is False or default == ():
        return None
    return " ".join(map(str, default)) if isinstance(default, tuple) else str(default)


def _version() -> str:
    from importlib.metadata import version

    return version("cutgrammar")
