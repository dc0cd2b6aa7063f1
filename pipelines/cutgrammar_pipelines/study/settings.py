"""What a study is asked to do: one settings file, by name from the package or one's own."""

from importlib.resources import files
from pathlib import Path

from pydantic.dataclasses import dataclass

from cutgrammar.settings import Settings, from_tables, read_tables, validated
from cutgrammar.settings.bounds import CHECKED, Count, Names, Natural, Text
from cutgrammar.trials.setups import SETUPS
from cutgrammar_pipelines.study.variants import TABLES


@dataclass(frozen=True, config=CHECKED)
class StudySettings:
    """What a study does; what it varies stands in `variants.TABLES`, and the other tables of its file are the
    `Settings` of every step.

    Attributes:
        seed: of the data, the training and the evaluation.
        trials: demonstrations to collect.
        setups: the setups of Table I to collect and evaluate.
        methods: the methods compared.
        goals: the goal conditions.
        world: where cuts are made.
        perception: what planners see; "cameras" trains the segmentation too.
        runs: seeds of planning and execution.
        test_trials: at most so many test trials of each setup, 0 for all.
        record: which trials to keep as recordings: none, failed or all.
    """

    seed: Natural = 0
    trials: Count = 110
    setups: Names = tuple(SETUPS)
    methods: Names = ("grammar", "random", "largest", "replay")
    goals: Names = ("in-place",)
    world: Text = "kinova"
    perception: Text = "truth"
    runs: Count = 5
    test_trials: Natural = 0
    record: Text = "none"


def preset_file(name: str) -> Path:
    """The settings file of a preset that comes with the package."""
    return Path(str(files("cutgrammar_pipelines") / "presets" / f"{name}.toml"))


def load_study(file: Path) -> tuple[StudySettings, Settings]:
    """A study's settings and those of its steps, from one TOML file.

    Raises:
        InputError: no such file, not TOML, an unknown table or name, or a value of another type or too small.
    """
    tables = read_tables(file)
    own = validated(StudySettings, tables.pop("study", {}), str(file), "study.")
    return own, from_tables({name: table for name, table in tables.items() if name not in TABLES}, str(file))
