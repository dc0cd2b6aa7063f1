"""The configs of `study` and `mlflow`."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from cutgrammar_pipelines.config.options import CHECKED, Address, LocalPath, Natural, PyModules, Workers


@dataclass(frozen=True, kw_only=True, config=CHECKED)
class StudyConfig:
    """Collect, split, train, evaluate and report from one settings file; every step resumes where it stopped.

    Preset demo: a few trials of every setup, in minutes. Preset paper: the full table on the bench, in hours. Preset
    seeds: fewer methods, for other data (--seed). Preset ablations: one change at a time, oracles, and a model of
    carrots that cuts potatoes, in hours.

    The tables [collect], [split], [train] and [evaluate] of the file take the options of these commands; all other
    tables are those of --settings elsewhere. Begin your own with: cutgrammar study --preset demo --print > mine.toml

    Example:
      cutgrammar study --preset demo --out demo

    Attributes:
        preset: settings file that comes with the package.
        out: folder of the data set, models, run and report.
        seed: seed to use instead of that of the file.
        settings: settings file to use instead of a preset.
        print: print the settings file and do nothing.
    """

    preset: Literal["demo", "paper", "seeds", "ablations"] = "demo"
    out: LocalPath = Path("out")
    seed: Natural | None = None
    settings: LocalPath | None = None
    print: bool = False
    workers: Workers = None
    address: Address = None
    py_module: PyModules = ()


@dataclass(frozen=True, kw_only=True, config=CHECKED)
class MlflowConfig:
    """Start MLflow's page on the store that train and evaluate write to, and open the chart of a study's scores.

    The chart begins with the score that decides, setup by setup, a bar for each method. The page is on this machine
    only, without MLflow's assistant and telemetry.

    Example:
      cutgrammar mlflow --port 5001

    Attributes:
        study: name of the study to open, which is that of the folder that holds its runs; the latest if not given.
        port: port of the page, on this machine only.
        no_browser: only start the server and print the address, which otherwise opens where there is a desktop.
    """

    study: str | None = None
    port: Annotated[int, Field(ge=1, le=65535)] = 5000
    no_browser: bool = False
