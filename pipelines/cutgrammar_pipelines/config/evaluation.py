"""The configs of `evaluate` and `plan`."""

from typing import Annotated, Literal

from cyclopts import Parameter
from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from cutgrammar.errors import InputError
from cutgrammar_pipelines.config.options import (
    CHECKED,
    DEFAULT,
    Address,
    Bodies,
    Count,
    FolderOrUrl,
    GoalCondition,
    Length,
    LocalPath,
    MethodName,
    Models,
    PyModules,
    Seed,
    SettingsOption,
    SetupName,
    Some,
    Unit,
    WatchOption,
    Workers,
    WorldName,
    one_size,
)
from cutgrammar_workers.tasks import MAX_FAULTS, START_SECONDS

DEFAULT_RUNS = 5
"""Runs of every trial with one model, as in the paper."""


@dataclass(frozen=True, kw_only=True, config=CHECKED)
class EvaluateConfig:
    """Plan and cut every test trial with every method, and score the fragments that result.

    One cut is planned and made at a time, until there are as many fragments as in the goal. Every record is saved at
    once: the same command resumes an interrupted evaluation, and does nothing if the evaluation is finished.

    How much training itself varies is seen with several models of the same training data and settings but other
    training seeds: run r then uses the model r.

    Example:
      cutgrammar evaluate --data data --model model --out run \\
        --methods grammar random --trials 2 --runs 1

    Attributes:
        data: data set with a split; a folder, or a URL of shared storage (s3://...), which every node fetches once.
        model: trained model, or several, each of which is a run; folders or URLs.
        out: folder of the run; created, or resumed if it exists.
        methods: methods to evaluate (all that are installed if not given; human only with --human).
        human: data sets (folders or URLs) in which people reproduced the goals of --data (record --reproduce), for the
            method human. Only goals that somebody reproduced are evaluated with it, and tables say how many.
        test_robots: also carry out reproductions that a test robot made, to test this software; no report takes such a
            run.
        setups: setups to evaluate (all that have test trials if not given).
        runs: seeds of planning and execution for every trial with one model (5 if not given); with several models,
            their number.
        trials: maximum number of test trials of each setup, those with the lowest numbers (all if not given).
        goals: in-place: the fragments of the goal lie where they were cut; scattered: apart and turned at random;
            foreign: they are what another object of the same categories, and of the same food where possible, was cut
            into, scaled to the same volume; foreign-food: the same with an object of another food.
        world: where the cuts are made.
        perception: what planners see: truth, the true fragments; scans, the goal's fragments as point clouds of their
            whole surfaces; cameras, in addition the current fragments as two depth cameras and a learned segmentation
            give them, for which train --vision is needed.
        arm: URDF file of an arm that replaces the Kinova Gen3 in the world kinova.
        flange: link of that URDF which the tool is fixed to.
        planners: planner actors that share each search; their number never changes a plan.
        record: trials to save as rerun recordings.
        artifacts: folder or URL (s3://...) of shared storage that workers write recordings to, instead of --out.
        watch: show the worlds, plans and scores while the run works, in a rerun viewer that is opened, or in the one at
            this port or URL; never changes a result.
        split: name of the split (that of the model if not given).
        allow_missing: continue without parts of the data set that are missing or damaged.
        retry: also carry out again the trials of an existing run that ended so; their earlier records are kept in the
            ledger, and count no more.
        failure_budget: number of faults of the machine (memory or disk full, a node that dies, a process that is killed
            from outside) after which a trial is given up without a score; the same command tries it again.
        max_start_seconds: a worker that takes longer to start (plugins are imported, the data set is fetched; waiting
            for a CPU does not count) is replaced, on another node if that recurs.
    """

    data: FolderOrUrl
    model: Models
    out: LocalPath
    methods: Some[MethodName] | None = None
    human: tuple[FolderOrUrl, ...] = ()
    test_robots: Annotated[bool, Parameter(show=False)] = False
    setups: Some[SetupName] | None = None
    runs: Count | None = None
    trials: Count | None = None
    goals: Some[GoalCondition] = ("in-place",)
    world: WorldName = "kinova"
    perception: Literal["truth", "scans", "cameras"] = "truth"
    arm: LocalPath | None = None
    flange: str | None = None
    planners: Count = 1
    record: Literal["none", "failed", "all"] = "none"
    artifacts: FolderOrUrl | None = None
    watch: WatchOption = None
    split: str | None = None
    allow_missing: bool = False
    retry: tuple[Literal["crashed", "timeout", "failed"], ...] = ()
    failure_budget: Count = MAX_FAULTS
    max_start_seconds: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] = START_SECONDS
    seed: Seed = 0
    settings: SettingsOption = DEFAULT
    workers: Workers = None
    address: Address = None
    py_module: PyModules = ()

    @model_validator(mode="after")
    def _fits_together(self) -> "EvaluateConfig":
        if self.planners > 1 and self.workers == 0:
            raise InputError(
                f"planners {self.planners} need Ray, and workers 0 does without it; give workers 1 or more"
            )
        if self.artifacts is not None and self.record == "none":
            raise InputError("--artifacts is where recordings go; give --record failed or --record all, too")
        if (self.arm is None) != (self.flange is None):
            raise InputError(
                "--arm and --flange go together: the URDF of an arm and the name of the link that the tool is fixed to"
            )
        if len(self.model) > 1 and self.runs not in (None, len(self.model)):
            raise InputError(
                f"runs {self.runs} do not go with {len(self.model)} models, each of which is one run; leave out runs, "
                "or give one model"
            )
        return self

    @property
    def n_runs(self) -> int:
        """Number of runs of every trial."""
        return len(self.model) if len(self.model) > 1 else self.runs or DEFAULT_RUNS


@dataclass(frozen=True, kw_only=True, config=CHECKED)
class PlanConfig:
    """Plan the cuts for your own fragments, from the current ones to a goal.

    Files hold fragments as scanners give them: meshes (STL, OBJ, PLY, GLB), each closed body of which is a fragment, or
    point clouds (PLY without faces) of one fragment each. All lie in one frame, anywhere. The planned cuts are carried
    out on their geometry, with a new plan after every cut. --out takes the whole plan: plan.json with the planes in the
    files' own frames, a picture of every step, and the recording plan.rrd.

    Example:
      cutgrammar plan --now potato.stl --goal halves.stl --unit mm --out plan

    Attributes:
        now: files of the current fragments.
        goal: files of the desired fragments.
        model: trained model; methods that learn nothing, and guided with structures that are not learned, need none.
        out: folder to write the plan to; or the name of its JSON file, beside which the others go.
        method: method that plans.
        unit: unit of the numbers in the files (metres if not given).
        length: real length of the longest current fragment with its unit, as 180mm, instead of --unit.
        up: axis of the files that points up (y in GLB files, z in others if not given).
        bodies: which bodies of a file are fragments: all, only the closed, only the largest, or the union of all.
    """

    now: Some[LocalPath]
    goal: Some[LocalPath]
    model: FolderOrUrl | None = None
    out: LocalPath | None = None
    method: MethodName = "guided"
    unit: Unit | None = None
    length: Length | None = None
    up: Literal["x", "y", "z"] | None = None
    bodies: Bodies = "all"
    seed: Seed = 0
    settings: SettingsOption = DEFAULT

    @model_validator(mode="after")
    def _fits_together(self) -> "PlanConfig":
        return one_size(self)
