"""The configs of `collect` and `split`."""

from dataclasses import KW_ONLY
from typing import Annotated, Literal

from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from cutgrammar_pipelines.config.options import (
    CHECKED,
    DEFAULT,
    Address,
    Bodies,
    Count,
    FolderOrUrl,
    Length,
    LocalPath,
    PyModules,
    Seed,
    SettingsOption,
    SetupName,
    Some,
    Unit,
    Workers,
    one_size,
)


@dataclass(frozen=True, kw_only=True, config=CHECKED)
class CollectConfig:
    """Let the scripted demonstrator cut foods, and save the demonstrations as a data set.

    The trials are spread over the setups in the proportions of the paper's 110 (40 of N1M1, 14 of each other setup).
    A setup is named by N, its initial objects, and M, the fragment categories in its goal. The same request gives the
    same bytes; it resumes an interrupted one, and does nothing if --out already holds this data set.

    Example:
      cutgrammar collect --out data --trials 20 --foods carrot my_scan.stl --unit mm

    Attributes:
        out: folder of the data set to make.
        trials: total number of trials.
        setups: setups to collect (all six, N1M1 to N3M4, if not given).
        foods: names of foods, or closed meshes as STL, OBJ, PLY or GLB files (carrot, cucumber, potato, courgette and
            block if not given).
        unit: unit of the numbers in mesh files (metres if not given).
        length: real length of the food in each mesh file with its unit, as 180mm, instead of --unit.
        bodies: what to take from a mesh file with several bodies: all (it is refused), only the closed, only the
            largest, or the union of all.
    """

    out: LocalPath
    trials: Count = 110
    setups: Some[SetupName] | None = None
    foods: Some[str] | None = None
    unit: Unit | None = None
    length: Length | None = None
    bodies: Bodies = "all"
    seed: Seed = 0
    settings: SettingsOption = DEFAULT
    workers: Workers = None
    address: Address = None
    py_module: PyModules = ()

    @model_validator(mode="after")
    def _fits_together(self) -> "CollectConfig":
        return one_size(self)


@dataclass(frozen=True, config=CHECKED)
class ImportConfig:
    """Make a data set of demonstrations that were recorded elsewhere: meshes, poses and planes as files.

    The folder has one JSON file for each demonstration and the meshes that it names; docs/howto/import.md describes
    them. What comes out of every cut is checked against its plane. The result can be split, merged and
    trained on as any data set. The same files give the same bytes; if --out already holds them, nothing is done.

    Example:
      cutgrammar import recorded --out data-recorded

    Attributes:
        folder: folder of the JSON files.
        out: folder of the data set to make.
        bodies: what to take from a mesh file with several bodies: all (it is refused), only the closed, only the
            largest, or the union of all.
    """

    folder: LocalPath
    _: KW_ONLY
    out: LocalPath
    bodies: Bodies = "all"


@dataclass(frozen=True, kw_only=True, config=CHECKED)
class RecordConfig:
    """Open the page on which people cut foods by hand; what they save becomes a data set.

    Several people can work at once, each with a code of their own, on tasks that are spread over the setups as in
    collect. A demonstration is on disk when the page says saved. The same command resumes: open demonstrations continue
    at their last cut. The result can be split and trained on, alone or with other data sets.

    Example:
      cutgrammar record --out data-by-hand --trials 20 --setups N1M1

    Attributes:
        out: folder of the data set, which grows with every demonstration saved.
        reproduce: data set (a folder or URL) whose test goals people are to reproduce, shown beside the board; trials
            keep their numbers.
        split: name of its split, for reproduce.
        trials: total number of tasks, each done by one person.
        setups: setups of the tasks (all six, N1M1 to N3M4, if not given).
        foods: names of foods, or closed meshes as STL, OBJ, PLY or GLB files (carrot, cucumber, potato, courgette and
            block if not given).
        unit: unit of the numbers in mesh files (metres if not given).
        host: address to serve the page at; any other than this machine's own wants a token, which is printed.
        port: port of the page; 0 finds a free one.
        allowed_hosts: names under which other machines open the page.
    """

    out: LocalPath
    reproduce: FolderOrUrl | None = None
    split: str = "paper"
    trials: Count = 110
    setups: Some[SetupName] | None = None
    foods: Some[str] | None = None
    unit: Unit | None = None
    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8765
    allowed_hosts: tuple[str, ...] = ()
    seed: Seed = 0
    settings: SettingsOption = DEFAULT


@dataclass(frozen=True, config=CHECKED)
class SplitConfig:
    """Write which trials of a data set train and which test; several data sets are first merged into one.

    Rule paper: 40 % of the N1M1 trials train, stratified by category, and all others test. Rule share: a share of
    every setup trains. Rule food: trials of some foods train, and foods that are never seen in training test.

    Example:
      cutgrammar split data --out data

    Attributes:
        data: data sets; folders, or URLs of shared storage (s3://...), which are merged or split into --out.
        out: data set that gets the split: DATA itself, or a new folder for the merged one.
        rule: which trials train.
        share: share of the trials that trains, for the rule share.
        foods: foods held out for testing, for the rule food (the last by name if not given).
    """

    data: Some[FolderOrUrl]
    _: KW_ONLY
    out: LocalPath
    rule: Literal["paper", "share", "food"] = "paper"
    share: Annotated[float, Field(gt=0, lt=1)] = 0.4
    foods: tuple[str, ...] = ()
