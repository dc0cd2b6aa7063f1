"""The commands that show what was done in a trial and hand it on: `film` and `export`."""

import argparse
from pathlib import Path
from typing import Any

from cutgrammar_pipelines.cli.options import add_command, whole_number


def add_film(commands: Any) -> None:
    """Add `film`."""

    def run(chosen: argparse.Namespace) -> int:
        from cutgrammar_pipelines.inspection.film import film

        return film(chosen.run, chosen.trial, chosen.out, chosen.stills, chosen.seconds)

    parser = add_command(
        commands,
        "film",
        run,
        "Film a trial: how the arm made its cuts, with the goal in the corner.",
        "The trial is carried out once more, same seeds, same result, and painted by casting rays, which takes some\n"
        "minutes and no graphics card. Cuts that no arm made are shown as what lay there after each.\n\n"
        "Example: cutgrammar film run N1M1-12-in-place-grammar-0-kinova-truth --out carrot.gif --stills carrot.png",
    )
    _trial(parser)
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE.webp|.gif|.png",
        help="the film (default TRIAL.webp; none with --stills alone)",
    )
    parser.add_argument(
        "--stills", type=Path, metavar="FILE.png", help="draw key frames beside the goal, as the paper's Fig. 6"
    )
    parser.add_argument(
        "--seconds", type=whole_number(1), default=30, metavar="N", help="longest film; time runs faster (default 30)"
    )


def add_export(commands: Any) -> None:
    """Add `export`."""

    def run(chosen: argparse.Namespace) -> int:
        from cutgrammar_pipelines.inspection.export import export

        return export(chosen.run, chosen.trial, chosen.out, chosen.rate)

    parser = add_command(
        commands,
        "export",
        run,
        "Write the joint trajectories that the arm carried out in a trial, for a real arm.",
        "As JSON of our own with everything in it, and as YAML with the fields of ROS's JointTrajectory, a document\n"
        "for each cut; docs/real_arm.md describes both. Positions, velocities and torques are held against the limits\n"
        "of the arm: the last line is `limits: kept`, or there is a line for each that is not kept and the exit code\n"
        "is 2.\n\n"
        "Example: cutgrammar export run N1M1-12-in-place-grammar-0-kinova-truth --out trajectories --rate 100",
    )
    _trial(parser)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FOLDER|FILE.json|FILE.yaml", help="a folder gets both files"
    )
    parser.add_argument("--rate", type=float, metavar="HZ", help="write about so many points a second (default: all)")


def _trial(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", type=Path, metavar="RUN", help="a folder that evaluate made")
    parser.add_argument("trial", metavar="TRIAL", help="which, as cutgrammar view RUN names it; a beginning will do")
