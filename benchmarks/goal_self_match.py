"""Match every goal of a data set with a remeshed, moved and shuffled copy of itself; the strict IoU must be 1.

Example:
    python benchmarks/goal_self_match.py data
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from cutgrammar.geometry.fragment import Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar.storage.data_set import DataSet
from cutgrammar.trials.goals import goal_for
from cutgrammar.trials.scoring import score

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("data", type=Path, help="a data set")
data, rng = DataSet.open(parser.parse_args().data), np.random.default_rng(0)
worst = 0.0
for summary in data.trials:
    goal = goal_for(data.demonstration(summary.trial), "in-place", rng)
    copy = []
    for fragment in goal:
        finer = trimesh.Trimesh(fragment.mesh.vertices, fragment.mesh.faces, process=False).subdivide()
        order = rng.permutation(len(finer.vertices))
        X = Pose(Rotation.random(rng=rng).as_matrix(), rng.uniform(-1, 1, 3))
        copy.append(Fragment(Mesh(X.apply(finer.vertices[order]), np.argsort(order)[finer.faces]), Pose.identity()))
    scored = score(tuple(copy[i] for i in rng.permutation(len(copy))), goal)
    worst = max(worst, abs(1.0 - scored.iou_strict))
print(f"{len(data.trials)} goals; maximum deviation of the strict IoU from 1: {worst:.2e} (limit 1e-9)")
sys.exit(worst > 1e-9)
