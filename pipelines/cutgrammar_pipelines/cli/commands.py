"""The commands of `cutgrammar`, their options and their help; each calls the function of the same name."""

import argparse
import os
from pathlib import Path
from typing import Any

from cutgrammar_pipelines.cli.arm_commands import add_export, add_film
from cutgrammar_pipelines.cli.options import Parser, add_command, allow_missing, computes, settings_of, whole_number

OVERVIEW = """\
Plan how to cut objects into desired fragments with a learned stochastic grammar, and measure how well it works.

The usual way through:
  cutgrammar collect  --out data                            demonstrations of cutting, as a data set
  cutgrammar split    data --out data                       which trials train and which test
  cutgrammar train    --data data --out model               the grammar and the networks
  cutgrammar evaluate --data data --model model --out run   plan and cut every test trial, with every method
  cutgrammar report   run --out report.html                 the table of scores
  cutgrammar view     run                                   a trial in rerun, as it happened
  cutgrammar film     run TRIAL                             what the arm did in it, as a film
  cutgrammar export   run TRIAL --out trajectories          its joint trajectories, for a real arm
or all of it from one settings file:
  cutgrammar study    --preset demo --out demo
"""


def build_parser() -> Parser:
    """The parser of all commands."""
    parser = Parser(prog="cutgrammar", description=OVERVIEW)
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    usual = (_collect, _split, _train, _evaluate, _plan, _report, _view, add_film, add_export, _show, _sync, _study)
    for add in (*usual, _mlflow, _doctor):
        add(commands)
    return parser


def _collect(commands: Any) -> None:
    def run(chosen: argparse.Namespace) -> int:
        from cutgrammar_pipelines.stages.collect import collect

        collect(
            chosen.out,
            trials=chosen.trials,
            seed=chosen.seed,
            setups=chosen.setups,
            foods=chosen.foods,
            unit=chosen.unit,
            workers=chosen.workers,
            address=chosen.address,
            settings=settings_of(chosen),
        )
        return 0

    parser = add_command(
        commands,
        "collect",
        run,
        "Let the scripted demonstrator cut foods and keep what it did as a data set.",
        "The trials are spread over the setups in the proportions of the paper's 110 (40 N1M1, 14 of each other).\n"
        "A setup is named by N, its initial objects, and M, the fragment categories in its goal.\n\n"
        "Example: cutgrammar collect --out data --trials 20 --foods carrot my_scan.stl --unit mm",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DATA", help="folder of the data set to make")
    parser.add_argument(
        "--trials", type=whole_number(1), default=110, help="how many in all (default 110, as the paper)"
    )
    parser.add_argument("--setups", nargs="+", metavar="NAME", help="only these (default: all six, N1M1 to N3M4)")
    parser.add_argument(
        "--foods", nargs="+", metavar="FOOD", help="names of foods, or closed meshes as STL, OBJ, PLY or GLB files"
    )
    parser.add_argument("--unit", choices=("mm", "cm", "m"), help="how to read the numbers in mesh files (default m)")
    computes(parser)


def _split(commands: Any) -> None:
    def run(chosen: argparse.Namespace) -> int:
        from cutgrammar_pipelines.stages.splitting import split

        split(chosen.data, chosen.out, rule=chosen.rule, share=chosen.share, foods=chosen.foods)
        return 0

    parser = add_command(
        commands,
        "split",
        run,
        "Write which trials train and which test; several data sets are merged into one first.",
        "paper: 40 % of N1M1, stratified by category, train; all else tests. share: 40 % of every setup trains.\n"
        "food: the trials of some foods train, foods never seen test.",
    )
    parser.add_argument("data", type=Path, nargs="+", metavar="DATA", help="data sets")
    parser.add_argument("--out", type=Path, required=True, metavar="DATA", help="the data set that gets the split")
    parser.add_argument("--rule", choices=("paper", "share", "food"), default="paper", help="(default paper)")
    parser.add_argument("--share", type=float, default=0.4, help="what trains, for the rule share (default 0.4)")
    parser.add_argument(
        "--foods", nargs="+", default=(), metavar="NAME", help="held out, for the rule food (default: the last)"
    )


def _train(commands: Any) -> None:
    def run(chosen: argparse.Namespace) -> int:
        from cutgrammar_pipelines.stages.train import train
        from cutgrammar_pipelines.tracking.mlflow_store import log_training

        trained = train(
            chosen.data,
            chosen.out,
            seed=chosen.seed,
            settings=settings_of(chosen),
            split=chosen.split,
            allow_missing=chosen.allow_missing,
            vision=chosen.vision,
        )
        log_training(trained, chosen.data)
        return 0

    parser = add_command(
        commands,
        "train",
        run,
        "Learn everything from the training trials: encoder, fragment types, grammar, classifier, cutting planes.",
        "Each part is logged to MLflow: its curves, the choice of k, the productions (see cutgrammar mlflow).",
    )
    parser.add_argument("--data", type=Path, required=True, metavar="DATA", help="a data set with a split")
    parser.add_argument("--out", type=Path, required=True, metavar="MODEL", help="folder of the model to make")
    parser.add_argument("--split", default="paper", metavar="NAME", help="which split of the data set (default paper)")
    parser.add_argument(
        "--vision",
        action="store_true",
        help="also learn to tell fragments apart in what depth cameras see, from simulated scenes of the training foods"
        " (some minutes more); evaluate --perception cameras needs it",
    )
    allow_missing(parser)
    computes(parser, distributed=False)


def _evaluate(commands: Any) -> None:
    def run(chosen: argparse.Namespace) -> int:
        from cutgrammar_pipelines.reports.build import build_report
        from cutgrammar_pipelines.reports.text import as_text
        from cutgrammar_pipelines.stages.arms import with_arm
        from cutgrammar_pipelines.stages.evaluate import evaluate
        from cutgrammar_pipelines.tracking.mlflow_store import log_evaluation

        summary = evaluate(
            chosen.data,
            chosen.model,
            chosen.out,
            methods=chosen.methods,
            setups=chosen.setups,
            runs=chosen.runs,
            trials=chosen.trials,
            goals=chosen.goals,
            world=chosen.world,
            perception=chosen.perception,
            planners=chosen.planners,
            record=chosen.record,
            workers=chosen.workers,
            address=chosen.address,
            seed=chosen.seed,
            settings=with_arm(settings_of(chosen), chosen.arm, chosen.flange),
            allow_missing=chosen.allow_missing,
        )
        report = build_report([chosen.out])
        print(as_text(report))
        log_evaluation(chosen.out, report)
        return 0 if summary.complete else 1

    parser = add_command(
        commands,
        "evaluate",
        run,
        "Plan and cut every test trial with every method, and score what comes out.",
        "One cut is planned and made at a time, until there are as many fragments as in the goal. Records are kept as\n"
        "they come: a killed evaluation goes on where it was when the same command is given again, and a finished one\n"
        "does nothing.\n\n"
        "Example: cutgrammar evaluate --data data --model model --out run --methods grammar random --trials 2 --runs 1",
    )
    parser.add_argument("--data", type=Path, required=True, metavar="DATA", help="a data set with a split")
    parser.add_argument("--model", type=Path, required=True, metavar="MODEL", help="a trained model")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="RUN", help="folder of the run, new or to be resumed"
    )
    parser.add_argument("--methods", nargs="+", metavar="NAME", help="(default: all that are installed)")
    parser.add_argument("--setups", nargs="+", metavar="NAME", help="only these (default: all that have test trials)")
    parser.add_argument("--runs", type=whole_number(1), default=5, help="seeds of planning and execution (default 5)")
    parser.add_argument("--trials", type=whole_number(1), metavar="K", help="at most K test trials of each setup")
    parser.add_argument(
        "--goals",
        nargs="+",
        choices=("in-place", "scattered"),
        default=["in-place"],
        help="goals as they lay after the demonstration, as in the paper, or scattered at random (default in-place)",
    )
    parser.add_argument(
        "--world",
        default="kinova",
        metavar="NAME",
        help="kinova (an arm makes the cuts, default), board (a free knife) or bench (geometry only, milliseconds)",
    )
    parser.add_argument(
        "--perception",
        choices=("truth", "cameras"),
        default="truth",
        help="what planners see: the fragments as they are (default), or what two depth cameras and a learned "
        "segmentation make of them (needs train --vision); goals then are point clouds too",
    )
    parser.add_argument(
        "--arm", type=Path, metavar="FILE.urdf", help="another arm than the Kinova Gen3 in the world kinova"
    )
    parser.add_argument("--flange", metavar="LINK", help="the link of that URDF which the tool is fixed to")
    parser.add_argument(
        "--planners",
        type=whole_number(1),
        default=1,
        metavar="N",
        help="planner actors that share each search; never changes a plan (default 1)",
    )
    parser.add_argument(
        "--record",
        choices=("none", "failed", "all"),
        default="none",
        help="which trials to keep as rerun recordings (default none)",
    )
    allow_missing(parser)
    computes(parser)


def _plan(commands: Any) -> None:
    def run(chosen: argparse.Namespace) -> int:
        from cutgrammar_pipelines.stages.plan import plan

        return plan(
            chosen.model,
            chosen.now,
            chosen.goal,
            chosen.out,
            method=chosen.method,
            unit=chosen.unit,
            seed=chosen.seed,
            settings=settings_of(chosen),
        )

    parser = add_command(
        commands,
        "plan",
        run,
        "Plan the cuts for your own fragments: from what lies there now to a goal.",
        "Each file holds one fragment in the world frame: a closed mesh (STL, OBJ, PLY, GLB) or, as PLY without faces\n"
        "but with normals, a point cloud. For meshes the cuts are carried out one after another, re-planning after\n"
        "each; for clouds the next cut alone is planned.",
    )
    parser.add_argument("--model", type=Path, required=True, metavar="MODEL", help="a trained model")
    parser.add_argument("--now", type=Path, nargs="+", required=True, metavar="FILE", help="the current fragments")
    parser.add_argument("--goal", type=Path, nargs="+", required=True, metavar="FILE", help="the fragments wanted")
    parser.add_argument("--out", type=Path, metavar="PLAN.json", help="write the plan here too")
    parser.add_argument("--method", default="grammar", metavar="NAME", help="(default grammar)")
    parser.add_argument("--unit", choices=("mm", "cm", "m"), help="how to read the numbers in the files (default m)")
    parser.add_argument("--seed", type=whole_number(0), default=0, help="(default 0)")
    parser.add_argument("--settings", type=Path, metavar="FILE.toml", help="change knobs")


def _report(commands: Any) -> None:
    def run(chosen: argparse.Namespace) -> int:
        from cutgrammar_pipelines.reports.build import report

        return report(chosen.runs, as_json=chosen.json, timing=not chosen.no_timing, out=chosen.out)

    parser = add_command(
        commands,
        "report",
        run,
        "The table of scores of one or more runs: as text, as JSON, as a page.",
        "All but the timing is reproduced exactly by the same seeds.",
    )
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN", help="folders that evaluate made")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")
    parser.add_argument("--no-timing", action="store_true", help="leave out what differs from time to time")
    parser.add_argument("--out", type=Path, metavar="FILE.html", help="write a self-contained page")


def _view(commands: Any) -> None:
    def run(chosen: argparse.Namespace) -> int:
        from cutgrammar_pipelines.inspection.view import view

        return view(chosen.run, chosen.trial, worst=chosen.worst, save=chosen.save)

    parser = add_command(
        commands,
        "view",
        run,
        "Show trials of a run in rerun, as they happened.",
        "Without TRIAL the worst ones are listed. A trial that was not recorded is carried out once more: same seeds,\n"
        "same answer.",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="a folder that evaluate made")
    parser.add_argument("trial", nargs="?", metavar="TRIAL", help="which, as the list of the worst names it")
    parser.add_argument("--worst", type=whole_number(1), default=10, metavar="N", help="how many to list (default 10)")
    parser.add_argument("--save", type=Path, metavar="FILE.rrd", help="write the recording here instead of showing it")


def _show(commands: Any) -> None:
    def run(chosen: argparse.Namespace) -> int:
        from cutgrammar_pipelines.inspection.show import show

        return show(chosen.folder, chosen.out, chosen.data)

    parser = add_command(
        commands,
        "show",
        run,
        "Tell what is in a data set, a model or a run, and check it against its digests; or draw it.",
        "With --out, pictures instead of words: of a data set, examples of every setup (the paper's Fig. 3); of a\n"
        "model, its grammar and, into a folder, how it was induced; of a run, into a folder, what a plan shares with\n"
        "a demonstration, one inference, what all methods reached, matched pairs (Fig. 1, 2, 4, 5).",
    )
    parser.add_argument("folder", type=Path, metavar="DATA|MODEL|RUN")
    parser.add_argument("--out", type=Path, metavar="FILE.svg|FILE.png|FOLDER", help="draw it; a run takes a folder")
    parser.add_argument(
        "--data",
        type=Path,
        metavar="DATA",
        help="of a model: the data set it was trained on, to show its types by (default: looked for beside the model)",
    )


def _sync(commands: Any) -> None:
    def run(chosen: argparse.Namespace) -> int:
        from cutgrammar_pipelines.reports.build import build_report
        from cutgrammar_pipelines.tracking.mlflow_store import log_evaluation, store_name

        if not log_evaluation(chosen.run, build_report([chosen.run])):
            return 1
        print(f"{chosen.run}: its scores are in MLflow at {store_name()} (cutgrammar mlflow starts its page)")
        return 0

    parser = add_command(
        commands,
        "sync",
        run,
        "Bring a run's scores to MLflow, e.g. after its server was away. Doing it twice changes nothing.",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="a folder that evaluate made")


def _study(commands: Any) -> None:
    def run(chosen: argparse.Namespace) -> int:
        from cutgrammar_pipelines.study.run import study
        from cutgrammar_pipelines.study.settings import preset_file

        return study(
            chosen.out,
            file=chosen.settings or preset_file(chosen.preset),
            workers=chosen.workers,
            address=chosen.address,
            show=chosen.print,
        )

    parser = add_command(
        commands,
        "study",
        run,
        "Collect, split, train, evaluate and report from one settings file; resumes where it was.",
        "demo: a few trials of every setup in minutes. paper: the full table on the bench, in hours.\n"
        "ablations: one thing changed at a time, oracles, and a model of carrots that cuts potatoes, in hours.\n"
        "A settings file has the tables of --settings elsewhere and a table [study]; to write your own, begin with\n"
        "cutgrammar study --preset demo --print > mine.toml.",
    )
    parser.add_argument("--preset", choices=("demo", "paper", "ablations"), default="demo", help="(default demo)")
    parser.add_argument("--out", type=Path, default=Path("out"), metavar="DIR", help="where all goes (default out)")
    parser.add_argument("--workers", type=whole_number(0), default=os.cpu_count() or 1, metavar="N", help="Ray actors")
    parser.add_argument("--address", metavar="ADDRESS", help="join a running Ray cluster")
    parser.add_argument("--settings", type=Path, metavar="FILE.toml", help="instead of a preset")
    parser.add_argument("--print", action="store_true", help="print the settings file and do nothing")


def _mlflow(commands: Any) -> None:
    def run(chosen: argparse.Namespace) -> int:
        from cutgrammar_pipelines.tracking.mlflow_store import serve

        return serve(chosen.port)

    parser = add_command(commands, "mlflow", run, "Start MLflow's page on the store that train and evaluate write to.")
    parser.add_argument("--port", type=whole_number(1), default=5000, help="on this machine only (default 5000)")


def _doctor(commands: Any) -> None:
    def run(_: argparse.Namespace) -> int:
        from cutgrammar_pipelines.inspection.doctor import doctor

        return doctor()

    add_command(commands, "doctor", run, "Tell what this machine has and lacks for each part of cutgrammar.")
