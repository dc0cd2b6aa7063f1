"""The options that several commands share: their types, bounds and help."""

import re
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar
from urllib.parse import urlsplit

from cyclopts import Group, Parameter, Token
from pydantic import AfterValidator, BeforeValidator, Field

from cutgrammar.errors import InputError, one_of
from cutgrammar.geometry.mesh_io.units import metres_of
from cutgrammar.plugins import METHODS, WORLDS, names_in
from cutgrammar.settings import Settings, load_settings
from cutgrammar.settings.bounds import CHECKED as CHECKED
from cutgrammar.settings.bounds import MOST
from cutgrammar.settings.bounds import Few as Few
from cutgrammar.trials.setups import SETUPS

COMPUTING = Group("Computing", sort_key=1)
DEFAULT: Any = None
"""Stands for `Settings()`; preparing the checks of all settings takes 20 ms, which help does without."""
T = TypeVar("T")


def _settings_of(value: object) -> object:
    """Settings as they are, those of a TOML file, or the default ones."""
    if value is DEFAULT:
        return Settings()
    return load_settings(Path(value)) if isinstance(value, str | Path) else value


def _paths_of(value: object) -> object:
    """One path or several as texts, which become paths both from Python and from JSON."""
    several = [value] if isinstance(value, str | Path) else value
    if not isinstance(several, list | tuple) or not all(isinstance(path, str | Path) for path in several):
        return value
    return tuple(map(str, several))


def _text_of(value: object) -> object:
    return str(value) if isinstance(value, Path) else value


def _place(place: str) -> str:
    """A path or URL as it is, if it can be one."""
    if "://" not in place:
        return place
    from cutgrammar.storage.shared_storage import check_url  # imports Arrow

    return check_url(place)


def _local(path: Path) -> Path:
    """A path as it is.

    Raises:
        InputError: it was a URL, which would otherwise become a folder `s3:` of this machine.
    """
    scheme, *rest = path.parts or ("",)
    if re.fullmatch(r"[A-Za-z][A-Za-z0-9+.-]+:", scheme):
        slashes = "///" if scheme == "file:" else "//"
        raise InputError(
            f"{scheme}{slashes}{'/'.join(rest)} is a URL, and this takes a folder or file of this machine; copy it "
            "from or to there with the store's own tool, e.g. aws s3 cp --recursive FOLDER URL"
        )
    return path


def _path_of(_: type, tokens: tuple[Token, ...]) -> Any:
    return Path(tokens[0].value)


def _known(what: str, known: Callable[[], list[str]]) -> AfterValidator:
    return AfterValidator(lambda name: one_of(what, name, known()))


def _length_of(text: str) -> str:
    metres_of(text)
    return text


def _one_place(places: tuple[Path, ...]) -> tuple[Path, ...]:
    """The place after --stills, if there is one.

    Raises:
        InputError: there are several.
    """
    if len(places) > 1:
        raise InputError(f"--stills takes one file or folder, not {len(places)}; write RUN and TRIAL before it")
    return places


def _viewer_at(words: tuple[str, ...]) -> tuple[str, ...]:
    """The viewer's URL of the words after --watch.

    Raises:
        InputError: they are not one URL or port.
    """
    if not words:
        return ()
    url = f"rerun+http://127.0.0.1:{words[0]}/proxy" if words[0].isdigit() else words[0]
    parts = urlsplit(url)
    good = parts.scheme in ("rerun", "rerun+http", "rerun+https") and parts.path == "/proxy" and parts.hostname
    if len(words) > 1 or not good or not 0 < (parts.port or 9876) < 65536:
        raise InputError(
            f"--watch {' '.join(words)} is no viewer; give the port of one on this machine, such as 9876, its URL, "
            "such as rerun+http://127.0.0.1:9876/proxy, or nothing to open one"
        )
    return (url,)


def one_size(config: T) -> T:
    """The config of a command with --unit and --length.

    Raises:
        InputError: both are given.
    """
    if getattr(config, "unit", None) is not None and getattr(config, "length", None) is not None:
        raise InputError("--unit and --length both say how large the files' numbers are; give one of them")
    return config


def _module_at(path: Path) -> Path:
    """The absolute path of a package or module that --py-module sends to a cluster.

    Raises:
        InputError: it is none, or not the one that this process imports, so that driver and nodes would differ.
    """
    if path.suffix == ".whl":
        raise InputError(f"--py-module {path} is a wheel; give the folder of its package, as installed here")
    inner = sorted(init.parent for pattern in ("*", "src/*") for init in path.glob(f"{pattern}/__init__.py"))
    if not (path / "__init__.py").exists() and inner:
        raise InputError(f"--py-module {path} holds packages and is none; give {' '.join(map(str, inner))}")
    if not (path.suffix == ".py" and path.is_file()) and not any(path.glob("**/*.py")):
        raise InputError(f"--py-module {path} is neither the folder of a Python package nor a .py file")
    path = path.resolve()
    try:
        spec = find_spec(path.stem)
    except ValueError:  # an imported module that has no spec
        spec = None
    found = [] if spec is None else [*(spec.submodule_search_locations or ()), spec.origin or ""]
    if path not in [Path(place).resolve() for place in found]:
        here = "nothing" if spec is None else found[0]
        raise InputError(
            f"--py-module {path}: import {path.stem} finds {here} in this process; install the package here, too "
            "(pip install -e)"
        )
    return path


Natural = Annotated[int, Field(ge=0, le=2**63 - 1)]
Count = Annotated[int, Field(ge=1, le=MOST)]
Maximum = Annotated[int, Field(ge=0, le=MOST)]
"""A largest number of something; 0 for all."""
MethodName = Annotated[str, _known("method", lambda: names_in(METHODS))]
WorldName = Annotated[str, _known("world", lambda: names_in(WORLDS))]
SetupName = Annotated[str, _known("setup", lambda: list(SETUPS))]
GoalCondition = Literal["in-place", "scattered", "foreign", "foreign-food"]
"""One of `cutgrammar.trials.goals.GOALS`, written out so that help shows them without importing what makes goals."""
Some = Annotated[tuple[T, ...], Field(min_length=1)]
"""One value or more."""

Unit = Literal["mm", "cm", "m", "in"]
"""Unit of the numbers in a mesh file."""
Length = Annotated[str, AfterValidator(_length_of)]
"""A length with its unit, such as "180mm"."""
Bodies = Literal["all", "closed", "largest", "union"]
"""Which bodies of a mesh file to keep, `mesh_io.bodies.Keep`, written out so that help does not import it."""

LocalPath = Annotated[Path, AfterValidator(_local)]
"""A folder or file of this machine."""
FolderOrUrl = Annotated[str, BeforeValidator(_text_of), AfterValidator(_place), Parameter(metavar="PATH|URL")]
"""A folder of this machine, or a URL of shared storage such as s3://bucket/folder."""
Models = Annotated[
    tuple[Annotated[str, AfterValidator(_place)], ...],
    BeforeValidator(_paths_of),
    Field(min_length=1),
    Parameter(metavar="PATH|URL"),
]
"""The folder or the URL of one model or of several."""

WatchOption = Annotated[
    tuple[str, ...] | None,
    AfterValidator(lambda words: None if words is None else _viewer_at(words)),
    Parameter(
        help="show what happens while it happens, in a rerun viewer that is opened, or in the one at this port or URL. "
        "Never changes a result.",
        metavar="[PORT|URL]",
    ),
]
"""None: nobody watches; empty: in a viewer that is opened; else the URL of one that runs."""

StillsOption = Annotated[
    tuple[Path, ...] | None,
    AfterValidator(lambda places: None if places is None else _one_place(places)),
    Parameter(metavar="[PNG|FOLDER]"),
]
"""None: no stills; empty: in a file with the trial's name; else the file or folder."""

Seed = Annotated[
    Natural,
    Parameter(group=COMPUTING, help="all randomness follows from it: the same seed gives the same result."),
]
SettingsOption = Annotated[
    Settings,
    BeforeValidator(_settings_of),
    Field(validate_default=True),
    Parameter(
        group=COMPUTING,
        help="TOML file that changes settings; one table for each part, e.g. [search] max_rounds = 100.",
        accepts_keys=False,
        n_tokens=1,
        metavar="PATH",
        converter=_path_of,
        show_default=False,
    ),
]
Workers = Annotated[
    Natural | None,
    Parameter(
        group=COMPUTING,
        help="number of Ray actors; 0 works in this process, without Ray. Never changes a result. [default: all cores, "
        "with --address those of the cluster]",
        show_default=False,
    ),
]
"""None: as many as there are cores."""
Address = Annotated[
    str | None,
    Parameter(
        group=COMPUTING, help="running Ray cluster to join, e.g. auto; without it, a Ray of this machine is started."
    ),
]
PyModules = Annotated[
    tuple[Annotated[Path, AfterValidator(_module_at)], ...],
    Parameter(
        name="--py-module",
        group=COMPUTING,
        help="with --address: folder of a Python package, or a .py file, to send to the cluster, such as a plugin that "
        "its nodes do not have; cutgrammar itself is sent always.",
        metavar="PATH",
    ),
]
UnusedWorkers = Annotated[
    Natural | None, Parameter(group=COMPUTING, help="accepted for scripts; this command works in one process.")
]
UnusedAddress = Annotated[
    str | None, Parameter(group=COMPUTING, help="accepted for scripts; this command works in one process.")
]
