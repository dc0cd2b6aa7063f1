"""Match every goal of a data set with a finer-meshed, re-posed, shuffled copy of itself: the strict IoU must be 1.

Run: python benchmarks/goal_self_match.py DATA
"""

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

data, rng = DataSet.open(Path(sys.argv[1])), np.random.default_rng(0)
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
print(f"{len(data.trials)} goals; greatest distance of a strict IoU from 1: {worst:.2e} (limit 1e-9)")
sys.exit(worst > 1e-9)
