"""The configs of the commands that show, report and pass on results."""

from dataclasses import KW_ONLY
from typing import Annotated

from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from cutgrammar.errors import InputError
from cutgrammar_pipelines.config.options import (
    CHECKED,
    Count,
    FolderOrUrl,
    LocalPath,
    MethodName,
    Seed,
    Some,
    StillsOption,
)

REPORT_ENDINGS = (".html", ".csv", ".tex")
"""What `report` can write."""


@dataclass(frozen=True, config=CHECKED)
class ReportConfig:
    """Print the tables of scores of one or more runs, as text or JSON, and write them as a page, CSV or LaTeX.

    The same seeds reproduce everything but the timing. Runs on several data sets, each with models of its own, are
    pooled: their models are nested in data sets.

    Example:
      cutgrammar report run --out report.html
      cutgrammar report run --out trials.csv
      cutgrammar report run --beside other-run --out both.html

    Attributes:
        runs: folders that evaluate made.
        against: methods that the others are tested against (grammar, grammar-plus and guided, of those that were
            evaluated, if not given).
        beside: another run, or several, to compare with RUNS trial by trial: both means, paired differences, and on the
            page the same trials of both, turned together.
        trials: trials that the page shows in three dimensions, beside the worst, median and best of each method; a name
            as cutgrammar view RUN lists it, or an unambiguous prefix of it.
        json: print one JSON object instead of a table.
        no_timing: leave out everything that depends on time.
        out: file to write, by its ending: .html, a self-contained page; .csv, one line for each trial of RUNS with all
            its scores; .tex, the tables for a paper.
    """

    runs: Some[LocalPath]
    _: KW_ONLY
    against: Some[str] | None = None
    beside: Some[LocalPath] | None = None
    trials: Some[str] | None = None
    json: bool = False
    no_timing: bool = False
    out: LocalPath | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> "ReportConfig":
        if self.out is not None and self.out.suffix not in REPORT_ENDINGS:
            raise InputError(f"--out {self.out}: a report is a file that ends in {', '.join(REPORT_ENDINGS)}")
        if self.beside and self.out is not None and self.out.suffix == ".csv":
            raise InputError("a CSV has the trials of RUNS, not those of --beside; name all runs before --out instead")
        return self


@dataclass(frozen=True, config=CHECKED)
class RateConfig:
    """Open the page on which people rate, from 1 to 5, how well results match their goals, without seeing the method.

    Several people can rate at once, each with a code of their own. Half of their pairs are the same for all, which
    shows how far they agree; both halves are spread evenly over methods, setups and goal conditions. For ten pairs
    there are two attention checks. A rating is on disk, in ratings.sqlite in the folder of its run, before the next
    pair is shown; report and MLflow show them. The same command resumes.

    Example:
      cutgrammar rate run --pairs 40

    Attributes:
        runs: folders that evaluate made.
        pairs: number of pairs that each person rates, without attention checks.
        methods: methods whose results are rated (all of the runs, if not given).
        host: address to serve the page at; any other than this machine's own wants a token, which is printed.
        port: port of the page; 0 finds a free one.
        allowed_hosts: names under which other machines open the page.
    """

    runs: Some[LocalPath]
    _: KW_ONLY
    pairs: Count = 40
    methods: Some[str] | None = None
    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8766
    allowed_hosts: tuple[str, ...] = ()
    seed: Seed = 0


@dataclass(frozen=True, config=CHECKED)
class ViewConfig:
    """Show trials of a run in rerun, step by step.

    Without TRIAL, the worst trials are listed. A trial without a recording is carried out again: the same seeds give
    the same result. With --compare two methods are shown side by side, by default on the trial in which the second
    loses most.

    Example:
      cutgrammar view run

      cutgrammar view run N1M1-1-in-place-grammar-0-kinova-truth

      cutgrammar view run --compare guided grammar

    Attributes:
        run: folder that evaluate made.
        trial: name of the trial, as in the list of the worst, or an unambiguous prefix of it.
        worst: number of trials to list.
        compare: two methods, to show the same trial of both side by side; TRIAL is then any of their trials.
        save: rerun file to write the recording to, instead of showing it.
    """

    run: LocalPath
    trial: str | None = None
    _: KW_ONLY
    worst: Count = 10
    compare: tuple[MethodName, MethodName] | None = None
    save: LocalPath | None = None


@dataclass(frozen=True, config=CHECKED)
class FilmConfig:
    """Film a trial: how the arm made its cuts, with the goal in the corner.

    The trial is carried out again, with the same seeds and the same result, and rendered by ray casting, which takes
    about a minute and needs no graphics card. Cuts that no arm made are shown as the fragments after each cut. Stills
    show the beginning, some cuts with the blade in the food, the result and the goal.

    Example:
      cutgrammar film run N1M1-1-in-place-grammar-0-kinova-truth

      cutgrammar film run N1M1-1-in-place-grammar-0-kinova-truth --stills

    Attributes:
        run: folder that evaluate made.
        trial: name of the trial, as cutgrammar view RUN lists it, or an unambiguous prefix of it.
        out: film to write, as WebP, GIF or PNG (TRIAL.webp if neither --out nor --stills is given).
        stills: make stills instead, or, with --out, too: one PNG, 1280 pixels wide, as the paper's Fig. 6 (TRIAL.png if
            nothing follows), or a folder that gets each of them, 1280 by 960.
        seconds: maximum length of the film; time runs faster if needed.
    """

    run: LocalPath
    trial: str
    _: KW_ONLY
    out: LocalPath | None = None
    stills: StillsOption = None
    seconds: Count = 30


@dataclass(frozen=True, config=CHECKED)
class ExportConfig:
    """Write the joint trajectories that the arm carried out in a trial, for a real arm.

    They are written as JSON with everything in it, and as YAML with the fields of ROS's JointTrajectory, one document
    for each cut; docs/real_arm.md describes both. Positions, velocities and torques are compared with the arm's
    limits: the last line is "limits: kept", or one line names each limit that is exceeded and the exit code is 2.

    Example:
      cutgrammar export run N1M1-1-in-place-grammar-0-kinova-truth \\
        --out trajectories --rate 100

    Attributes:
        run: folder that evaluate made.
        trial: name of the trial, as cutgrammar view RUN lists it, or an unambiguous prefix of it.
        out: JSON or YAML file, or a folder that gets both.
        rate: approximate number of points per second to write (all if not given; in YAML a cut has at most 1,000).
    """

    run: LocalPath
    trial: str
    _: KW_ONLY
    out: LocalPath
    rate: Annotated[float, Field(gt=0)] | None = None


@dataclass(frozen=True, config=CHECKED)
class ShowConfig:
    """Describe a data set, a model or a run, and check it against its digests; or draw it.

    With --out, pictures are drawn instead. A data set: examples of every setup (the paper's Fig. 3). A model: its
    grammar and, if --out is a folder, how it was induced. A run, into a folder: a plan beside a demonstration, one
    inference, the results of all methods, matched pairs (Fig. 1, 2, 4, 5).

    Example:
      cutgrammar show model --out grammar.svg

    Attributes:
        place: folder of a data set, a model or a run, or its URL (s3://...).
        out: SVG or PNG file, or a folder, to draw into; a run needs a folder.
        data: data set (a folder or URL) that the model was trained on, whose fragments illustrate its types (found
            beside the model's folder if not given).
    """

    place: FolderOrUrl
    _: KW_ONLY
    out: LocalPath | None = None
    data: FolderOrUrl | None = None


@dataclass(frozen=True, config=CHECKED)
class SyncConfig:
    """Write a run's scores to MLflow, e.g. after its server was down. Repeating it changes nothing.

    Example:
      cutgrammar sync run

    Attributes:
        run: folder that evaluate made.
    """

    run: LocalPath
