"""What a recording shows, read back from its file: where a trial began, what was wanted, what was reached."""

from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import RrdReader

from cutgrammar.errors import InputError
from cutgrammar.geometry.fragment import Configuration, Fragment, Mesh
from cutgrammar.geometry.pose import Pose
from cutgrammar_dashboards.recording import blueprint

MESH, FACES, PLACE, TURN = (
    "Mesh3D:vertex_positions",
    "Mesh3D:triangle_indices",
    "Transform3D:translation",
    "Transform3D:mat3x3",
)


def configurations_of(path: Path) -> tuple[Configuration, Configuration, Configuration] | None:
    """Start, goal and what was reached, of a trial recorded in `path`.

    Shapes have the single precision of the file and vertices doubled along edges: good to look at, not to compute
    with. Where the recording ends early, or shows clouds instead of meshes, there is no answer: None.

    Raises:
        InputError: the file is not a recording.
    """
    meshes: dict[str, tuple[Any, Any]] = {}
    poses: dict[str, tuple[int, Any, Any]] = {}  # the earliest of each, for chunks stand in no particular order
    began: set[str] = set()
    try:
        for chunk in RrdReader(str(path)).stream():
            columns = chunk.to_record_batch().to_pydict()
            entity = chunk.entity_path.strip("/")
            for i, step in enumerate(columns.get("step", ())):
                if MESH in columns and columns[MESH][i] is not None:
                    meshes[entity] = columns[MESH][i], columns[FACES][i]
                    if step == 0:
                        began.add(entity)
                if TURN in columns and columns[TURN][i] is not None:
                    tick = columns["round"][i]
                    if entity not in poses or tick < poses[entity][0]:
                        poses[entity] = tick, columns[PLACE][i][0], columns[TURN][i][0]
    except (OSError, ValueError, RuntimeError) as error:
        raise InputError(
            f"{path} cannot be read as a recording ({error}); remove it, and `cutgrammar view` makes it anew"
        ) from None

    def found(root: str, chosen: set[str]) -> Configuration:
        names = [name for name in chosen if name.rpartition("/")[0] == root and name in meshes and name in poses]
        names.sort(key=lambda name: int(name.rpartition("/")[2]))
        return tuple(_fragment(*meshes[name], *poses[name][1:]) for name in names)

    start = found(blueprint.NOW, began)
    goal, reached = (found(root, set(meshes)) for root in (blueprint.GOAL, f"{blueprint.MATCHED}/reached"))
    return (start, goal, reached) if start and goal and reached else None


def _fragment(vertices: Any, faces: Any, place: Any, turn: Any) -> Fragment:
    columns = np.asarray(turn, dtype=np.float64).reshape(3, 3)  # rerun writes matrices column by column
    u, _, v = np.linalg.svd(columns.T)
    return Fragment(Mesh(np.asarray(vertices), np.asarray(faces)), Pose(u @ v, np.asarray(place)))
