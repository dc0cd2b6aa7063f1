"""The commands about what an arm did in a trial: `film` and `export`."""

import argparse
from pathlib import Path
from typing import Any

from cutgrammar_pipelines.options import add_command


def add_film(commands: Any) -> None:
    """Add `film`."""

    def run(chosen: argparse.Namespace) -> int:
        from cutgrammar_pipelines.film import film

        return film(chosen.run, chosen.trial, chosen.out, chosen.stills)

    parser = add_command(
        commands,
        "film",
        run,
        "Film what the arm did in a trial, as a camera in the scene sees it.",
        "The trial is carried out once more, same seeds, same result, and drawn by SAPIEN's renderer, which needs a\n"
        "Vulkan device (cutgrammar doctor tells).\n\n"
        "Example: cutgrammar film run N1M1-12-in-place-grammar-0-kinova-truth --out carrot.mp4 --stills carrot.png",
    )
    _trial(parser)
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE.gif|.webp|.mp4",
        help="the film (default: TRIAL.webp; none with --stills alone)",
    )
    parser.add_argument(
        "--stills", type=Path, metavar="FILE.png", help="draw key frames beside the goal, as the paper's Fig. 6"
    )


def add_export(commands: Any) -> None:
    """Add `export`."""

    def run(chosen: argparse.Namespace) -> int:
        from cutgrammar_pipelines.export import export

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
    parser.add_argument("run", type=Path, metavar="RUN", help="a folder that evaluate made, with --world kinova")
    parser.add_argument("trial", metavar="TRIAL", help="which, as cutgrammar view RUN names it; a beginning will do")
