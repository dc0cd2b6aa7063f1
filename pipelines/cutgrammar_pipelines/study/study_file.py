"""The settings file of a study: the configs of its steps, its variants and transfers."""

from dataclasses import dataclass, fields, replace
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

from pydantic.dataclasses import dataclass as checked

from cutgrammar.errors import InputError, closest, listed
from cutgrammar.settings import Settings, from_tables, read_tables, validated
from cutgrammar_pipelines.config import CollectConfig, EvaluateConfig, SplitConfig, StudyConfig, TrainConfig
from cutgrammar_pipelines.config.options import CHECKED, Few, Natural
from cutgrammar_pipelines.study.variants import Variations, read_variations

NOT_IN_FILE = ("out", "data", "model", "seed", "settings", "workers", "address", "py_module", "watch", "test_robots")
"""Options of the steps that a study's file does not name: the study itself sets them, or they are no part of one."""


@checked(frozen=True, config=CHECKED)
class StudyTable:
    """The table `[study]`.

    Attributes:
        seed: of the data set, the training and the evaluation.
        models: number of trained models; of several, model i is trained with seed + i, and each is one run.
    """

    seed: Natural = 0
    models: Few = 1


@dataclass(frozen=True)
class Study:
    """A study, ready to run.

    Attributes:
        out: its folder, with `data`, `model` (of several, `model-0`, `model-1`, ...) and `run` of the main evaluation.
        collect, split, evaluate: the configs of these steps.
        trainings: the config of each training.
        variations: variants and transfers.
    """

    out: Path
    collect: CollectConfig
    split: SplitConfig
    trainings: tuple[TrainConfig, ...]
    evaluate: EvaluateConfig
    variations: Variations

    @property
    def settings(self) -> Settings:
        """The settings of every step."""
        return self.train.settings

    @property
    def train(self) -> TrainConfig:
        """The first training, which variants repeat with changes."""
        return self.trainings[0]

    @property
    def ablations(self) -> Path:
        """The folder of all variants and transfers."""
        return self.out / "ablations"


STEPS = {"collect": CollectConfig, "split": SplitConfig, "train": TrainConfig, "evaluate": EvaluateConfig}
"""Table of the file -> the command whose options it has."""
S = TypeVar("S", CollectConfig, SplitConfig, TrainConfig, EvaluateConfig)


def file_of(config: StudyConfig) -> Path:
    """The settings file that the study reads: the user's, or that of a preset."""
    return config.settings or Path(str(files("cutgrammar_pipelines") / "presets" / f"{config.preset}.toml"))


def load_study(config: StudyConfig) -> Study:
    """The study that the settings file describes.

    Raises:
        InputError: no such file, not TOML, an unknown table or name, or a value of another type or out of bounds.
    """
    file, out = file_of(config), config.out
    tables = read_tables(file)
    study = tables.pop("study", {})
    _check_homes(study, file)
    table = validated(StudyTable, study, str(file), "study.")
    seed = table.seed if config.seed is None else config.seed
    steps = {name: tables.pop(name, {}) for name in STEPS}
    variations = read_variations(tables, str(file))
    settings = from_tables(tables, str(file))
    data, models = out / "data", [out / "model"]
    if table.models > 1:
        models = [out / f"model-{number}" for number in range(table.models)]
    shared = {"seed": seed, "workers": config.workers, "address": config.address}
    modules = {"py_module": config.py_module}

    def step(cls: type[S], name: str, **given: Any) -> S:
        """The config of a step from its table in the file and the values that the study gives."""
        table = steps[name]
        if not isinstance(table, dict):
            return validated(cls, table, str(file), f"{name}.")
        known = [field.name for field in fields(cls) if field.name not in NOT_IN_FILE]
        for word in table:
            if word not in known:
                message = f"{file}: unknown setting {name}.{word}; known: {listed(known)}{closest(word, known)}"
                raise InputError(message)
        return validated(cls, {**table, **given}, str(file), f"{name}.")

    if isinstance(steps["train"], dict) and isinstance(steps["evaluate"], dict):
        steps["train"].setdefault("vision", steps["evaluate"].get("perception") == "cameras")
    train = replace(step(TrainConfig, "train", data=data, out=models[0], **shared), settings=settings)
    return Study(
        out=out,
        collect=replace(step(CollectConfig, "collect", out=data, **shared, **modules), settings=settings),
        split=step(SplitConfig, "split", data=[str(data)], out=data),
        trainings=tuple(replace(train, out=model, seed=seed + number) for number, model in enumerate(models)),
        evaluate=replace(
            step(EvaluateConfig, "evaluate", data=data, model=models, out=out / "run", **shared, **modules),
            settings=settings,
        ),
        variations=variations,
    )


def _check_homes(study: object, file: Path) -> None:
    """Refuse the table `[study]` of version 0.1.0, which had the options of all steps, with a line that helps."""
    for word in study if isinstance(study, dict) else ():
        option = {"test_trials": "trials"}.get(word, word)
        homes = [name for name, cls in STEPS.items() if option in {field.name for field in fields(cls)}]
        if homes and word not in {field.name for field in fields(StudyTable)}:
            places = " or ".join(f"{option} in the table [{home}]" for home in homes)
            raise InputError(f"{file}: study.{word} is of version 0.1.0; write {places}, as in presets of today")
