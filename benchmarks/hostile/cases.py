"""One hostile input: how good files are spoiled, the command that reads them, and what its message must name."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hostile.good import change_json, sign_data, sign_model

READ = {
    "manifest": "show data",
    "tables": "show data",
    "split": "show data",
    "model": "show model",
    "grammar": "show model",
    "run": "report run --out ../out/report.html",
    "ledger": "report run --out ../out/report.html",
    "recording": "view run N1M1-{trial}-in-place-random --save ../out/one.rrd",
    "settings": "collect --out ../out/data --trials 1 --setups N1M1 --foods block --workers 0 --settings settings.toml",
    "study": "study --settings study.toml --out ../out/study --print",
    "mesh": "collect --out ../out/data --trials 1 --setups N1M1 --workers 0 --foods",
    "urdf": "evaluate --data data --model model --out ../out/run --methods random --world bench --trials 1 --runs 1 "
    "--workers 0 --arm arm.urdf --flange flange",
}
"""The command that reads each kind of file, in the folder that holds copies of the good ones."""

WARM_UP = (
    READ["urdf"],
    f"{READ['mesh']} box.stl",
    "view run",
    *(command.format(trial=1) for reader, command in READ.items() if reader not in ("recording", "mesh", "urdf")),
)
"""Commands on good files that import all that those on hostile ones need. First the one that logs: MLflow changes the
environment, and processes that read files are then forked from a new template."""


@dataclass(frozen=True)
class Case:
    """A hostile input.

    Attributes:
        reader: what reads it, one of `READ`.
        name: what is wrong with it.
        spoil: makes it in a folder with copies of the good files.
        named: words that the message must contain.
        command: what is run there; by default that of the reader.
        may_pass: whether the command may accept it.
    """

    reader: str
    name: str
    spoil: Callable[[Path], Any]
    named: Sequence[str] = ()
    command: str = ""
    may_pass: bool = False

    @property
    def words(self) -> list[str]:
        """The words of the command."""
        return (self.command or READ[self.reader]).split()


def put(tree: Any, path: Sequence[str | int], value: Any) -> None:
    """Replace what is at `path` in nested lists and dictionaries; `...` as value removes it."""
    *way, last = path
    for part in way:
        tree = tree[part]
    if value is ...:
        del tree[last]
    else:
        tree[last] = value


def json_case(
    reader: str, file: str, path: Sequence[str | int], value: Any, named: Sequence[str] | None = None, **options: Any
) -> Case:
    """A case in which one value of a JSON file is another; digests are made anew."""

    def spoil(folder: Path) -> None:
        change_json(folder / file, lambda tree: put(tree, path, value))
        sign(folder, file)

    field = [str(part) for part in path if isinstance(part, str)][-1:]
    name = f"{file}: {'.'.join(map(str, path))} = {'missing' if value is ... else repr(value)[:40]}"
    return Case(reader, name, spoil, named if named is not None else [Path(file).name, *field], **options)


def bytes_case(reader: str, file: str, name: str, content: bytes | Callable[[bytes], bytes], **options: Any) -> Case:
    """A case in which a file has another content; digests are made anew."""

    def spoil(folder: Path) -> None:
        target = folder / file
        target.write_bytes(content if isinstance(content, bytes) else content(target.read_bytes()))
        sign(folder, file)

    return Case(reader, f"{file}: {name}", spoil, **{"named": [Path(file).name], **options})


def sign(folder: Path, file: str) -> None:
    """Make the digests anew that cover a file."""
    if file.startswith("data/") and not file.startswith("data/splits"):
        with suppress(ValueError, KeyError, TypeError, AttributeError, RecursionError, OSError):  # none can read it
            sign_data(folder / "data")
    if file.startswith("model/") and not file.endswith("model.json"):
        sign_model(folder / "model")
