"""The tables of a data set (trials, fragments, poses, cuts), and conversion of demonstrations to rows and back.

A part contains the rows of some trials of one table as Parquet, with one row group per trial, so that a single trial
can be read. Equal rows give equal bytes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from cutgrammar.demonstration import DemonstratedCut, DemonstratedFragment, Demonstration, HandStroke
from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.geometry.fragment import Mesh
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.pose import Pose
from cutgrammar.storage.demonstration_check import (
    WrongRowsError,
    check_columns,
    check_meshes,
    check_references,
    check_summary,
)
from cutgrammar.storage.part_footers import opened_part, trust_footer

POINTS = pa.list_(pa.list_(pa.field("axis", pa.float64(), nullable=False), 3))
TRIANGLES = pa.list_(pa.list_(pa.field("corner", pa.int32(), nullable=False), 3))
PLANE = pa.list_(pa.field("number", pa.float64(), nullable=False), 4)
POSE = pa.list_(pa.field("number", pa.float64(), nullable=False), 7)
VECTOR = pa.list_(pa.field("number", pa.float64(), nullable=False), 3)

SCHEMAS: dict[str, pa.Schema] = {
    "trials": pa.schema(
        {
            "trial": pa.int32(),
            "setup": pa.string(),
            "foods": pa.list_(pa.string()),
            "categories": pa.list_(pa.string()),
            "demonstrator": pa.string(),
            "seed": pa.int64(),
            "fragments": pa.int32(),
            "cuts": pa.int32(),
        }
    ),
    "fragments": pa.schema(
        {
            "trial": pa.int32(),
            "fragment": pa.int32(),
            "parent": pa.int32(),
            "step": pa.int32(),
            "category": pa.string(),
            "vertices": POINTS,
            "faces": TRIANGLES,
        }
    ),
    "poses": pa.schema({"trial": pa.int32(), "step": pa.int32(), "fragment": pa.int32(), "X_WF": POSE}),
    "cuts": pa.schema(
        {
            "trial": pa.int32(),
            "step": pa.int32(),
            "plane_W": PLANE,
            "plane_C": PLANE,
            "fragment": pa.int32(),
            "products": pa.list_(pa.int32()),
            "undone": pa.bool_(),
        }
    ),
}
"""The tables of every part and their columns. `fragments` of a trial is the number in its goal, `cuts` the number not
undone; a plane is n, d [m]; a pose is x y z [m] and the quaternion w x y z; meshes are in their frame F [m]."""

BY_HAND: dict[str, pa.Schema] = {
    "strokes": pa.schema(
        {
            "trial": pa.int32(),
            "step": pa.int32(),
            "p_WE": VECTOR,
            "first_W": VECTOR,
            "second_W": VECTOR,
            "explode": pa.float64(),
            "first_seconds": pa.float64(),
            "second_seconds": pa.float64(),
            "cut_seconds": pa.float64(),
            "undone_seconds": pa.float64(),
        }
    ),
}
"""The tables that only parts with demonstrations made by hand have; see `HandStroke` for the columns."""

ALL_SCHEMAS = SCHEMAS | BY_HAND

Tables = Mapping[str, pa.Table]
"""The rows of one trial in every table that it has rows in, and in all of `SCHEMAS`."""


@dataclass(frozen=True)
class TrialSummary:
    """A row of the table `trials`.

    Attributes:
        trial: number within the data set.
        setup: name of the setup.
        foods: name of the food of every initial object.
        categories: the categories in the goal.
        demonstrator: name of the demonstrator.
        seed: seed of the data set that it was made for.
        fragments: number of fragments in the goal.
        cuts: number of cuts that were not undone.
    """

    trial: int
    setup: str
    foods: tuple[str, ...]
    categories: tuple[str, ...]
    demonstrator: str
    seed: int
    fragments: int
    cuts: int


def summary_of(demonstration: Demonstration) -> TrialSummary:
    """The row of a demonstration in the table `trials`."""
    d = demonstration
    made = sum(not cut.undone for cut in d.cuts)
    return TrialSummary(d.trial, d.setup, d.foods, d.categories, d.demonstrator, d.seed, len(d.alive(d.steps)), made)


# --- to rows ----------------------------------------------------------------------------------------------------------


def tables_of(demonstration: Demonstration) -> Tables:
    """The rows of one demonstration in every table.

    Raises:
        ValueError: the ids of its fragments are not 0, 1, 2, ...
    """
    d, summary = demonstration, summary_of(demonstration)
    if [fragment.id for fragment in d.fragments] != list(range(len(d.fragments))):
        raise ValueError(f"trial {d.trial}: the fragments' ids are not 0 to {len(d.fragments) - 1} in order")
    alive = sorted(d.poses)
    rows: dict[str, dict[str, object]] = {
        "trials": {name: [getattr(summary, name)] for name in SCHEMAS["trials"].names},
        "fragments": {
            "trial": [d.trial] * len(d.fragments),
            "fragment": [f.id for f in d.fragments],
            "parent": [f.parent for f in d.fragments],
            "step": [f.step for f in d.fragments],
            "category": [f.category for f in d.fragments],
            "vertices": _ragged([f.mesh.vertices for f in d.fragments], POINTS),
            "faces": _ragged([f.mesh.faces for f in d.fragments], TRIANGLES),
        },
        "poses": {
            "trial": [d.trial] * len(alive),
            "step": [step for step, _ in alive],
            "fragment": [fragment for _, fragment in alive],
            "X_WF": _fixed([d.poses[key].to_vector() for key in alive], POSE),
        },
        "cuts": {
            "trial": [d.trial] * len(d.cuts),
            "step": [cut.step for cut in d.cuts],
            "plane_W": _fixed([cut.plane_W.to_vector() for cut in d.cuts], PLANE),
            "plane_C": _fixed([cut.plane_C.to_vector() for cut in d.cuts], PLANE),
            "fragment": [cut.fragment for cut in d.cuts],
            "products": [list(cut.products) for cut in d.cuts],
            "undone": [cut.undone for cut in d.cuts],
        },
    }
    if d.strokes:
        rows["strokes"] = {
            "trial": [d.trial] * len(d.strokes),
            **{
                name: _fixed([getattr(stroke, name) for stroke in d.strokes], VECTOR)
                if schema == VECTOR
                else [getattr(stroke, name) for stroke in d.strokes]
                for name, schema in zip(BY_HAND["strokes"].names[1:], BY_HAND["strokes"].types[1:], strict=True)
            },
        }
    return {table: pa.table(columns, schema=ALL_SCHEMAS[table]) for table, columns in rows.items()}


def renumbered(tables: Tables, trial: int) -> Tables:
    """The rows with another trial number."""
    return {
        name: table.set_column(0, ALL_SCHEMAS[name].field(0), pa.array([trial] * table.num_rows, pa.int32()))
        for name, table in tables.items()
    }


def write_part(path: Path, table: str, trials: Sequence[Tables]) -> None:
    """Write the rows of some trials of one table, with one row group per trial, which may be empty."""
    schema = ALL_SCHEMAS[table]
    with pq.ParquetWriter(path, schema, compression="zstd", use_dictionary=False) as writer:
        for tables in trials:
            rows = tables[table] if table in tables else schema.empty_table()
            writer.write_table(rows, row_group_size=max(1, rows.num_rows))
    trust_footer(path)


# --- from rows --------------------------------------------------------------------------------------------------------


def read_group(path: Path, table: str, group: int) -> pa.Table:
    """Row group `group` of a part.

    Raises:
        OSError, ValueError: the file cannot be read, or has another table.
    """
    with opened_part(path, ALL_SCHEMAS[table], table) as file:
        if group >= file.num_row_groups:
            raise ValueError(f"it has {file.num_row_groups} row groups, one for each trial; {group + 1} were expected")
        return file.read_row_group(group, use_threads=False)


def read_summaries(path: Path) -> list[TrialSummary]:
    """The rows of a part of the table `trials`.

    Raises:
        OSError, ValueError: the file cannot be read, or has another table.
    """
    with opened_part(path, SCHEMAS["trials"], "trials") as file:
        rows = file.read(use_threads=False).to_pylist()
    for number, row in enumerate(rows):
        check_summary(row, number)
    return [_summary_from(row) for row in rows]


def demonstration_from(summary: TrialSummary, tables: Tables) -> Demonstration:
    """The inverse of `tables_of`.

    Raises:
        WrongRowsError: the rows are not a valid demonstration.
    """
    fragments, poses, cuts = (tables[name].combine_chunks() for name in ("fragments", "poses", "cuts"))
    strokes = tables.get("strokes", BY_HAND["strokes"].empty_table())
    for name, rows in (("fragments", fragments), ("poses", poses), ("cuts", cuts), ("strokes", strokes)):
        check_columns(name, rows, summary.trial)
    check_references(summary, {"fragments": fragments, "poses": poses, "cuts": cuts, "strokes": strokes})
    vertices, of_vertices = _parts(fragments["vertices"])
    faces, of_faces = _parts(fragments["faces"])
    faces = faces.astype(np.int64)
    check_meshes(summary.trial, vertices, of_vertices, faces, of_faces)
    meshes = [
        Mesh(vertices[a:b], faces[c:d])
        for (a, b), (c, d) in zip(pairwise(of_vertices.tolist()), pairwise(of_faces.tolist()), strict=True)
    ]
    parents, steps, categories = (fragments[name].to_pylist() for name in ("parent", "step", "category"))
    demonstrated = map(DemonstratedFragment, range(len(meshes)), parents, steps, categories, meshes)
    keys = zip(poses["step"].to_pylist(), poses["fragment"].to_pylist(), strict=True)
    planes = [_planes(name, _rows(cuts[name], 4), summary.trial) for name in ("plane_W", "plane_C")]
    made = zip(
        cuts["step"].to_pylist(),
        *planes,
        cuts["fragment"].to_pylist(),
        map(tuple, cuts["products"].to_pylist()),
        cuts["undone"].to_pylist(),
        strict=True,
    )
    return Demonstration(
        trial=summary.trial,
        setup=summary.setup,
        foods=summary.foods,
        categories=summary.categories,
        demonstrator=summary.demonstrator,
        seed=summary.seed,
        fragments=tuple(demonstrated),
        poses=dict(zip(keys, _poses(_rows(poses["X_WF"], 7), summary.trial), strict=True)),
        cuts=tuple(DemonstratedCut(*facts) for facts in made),
        strokes=tuple(HandStroke(*list(row.values())[1:]) for row in strokes.to_pylist()),
    )


def _summary_from(row: Mapping[str, Any]) -> TrialSummary:
    facts: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in row.items()}
    return TrialSummary(**facts)


def _fixed(rows: Sequence[Floats], kind: pa.DataType) -> pa.Array:
    """Convert rows of equal length to a column of fixed-size lists."""
    flat = np.concatenate(rows) if rows else np.zeros(0)
    return pa.FixedSizeListArray.from_arrays(pa.array(flat, kind.value_type), type=kind)


def _ragged(blocks: Sequence[Floats] | Sequence[Ints], kind: pa.DataType) -> pa.Array:
    """Convert blocks (n_i, 3) to a column of lists of triples."""
    bounds = np.cumsum([0, *(len(block) for block in blocks)])
    triples = kind.value_type
    flat = np.concatenate(blocks).reshape(-1)
    inner = pa.FixedSizeListArray.from_arrays(pa.array(flat, triples.value_type), type=triples)
    return pa.ListArray.from_arrays(pa.array(bounds, pa.int32()), inner, type=kind)


def _rows(column: pa.ChunkedArray, width: int) -> Floats:
    """(n, width) numbers of a column of fixed-size lists."""
    flat = column.combine_chunks().flatten()
    return np.asarray(flat.to_numpy(zero_copy_only=False)).reshape(-1, width)


def _planes(name: str, rows: Floats, trial: int) -> list[Plane]:
    """The planes of rows (n, 4)."""
    try:
        return [Plane(row[:3], float(row[3])) for row in rows]
    except ValueError as error:
        raise WrongRowsError("cuts", f"{name} of a cut of trial {trial}: {error}") from None


def _poses(rows: Floats, trial: int) -> list[Pose]:
    """The poses of rows (n, 7); equal rows share one object."""
    known = {row.tobytes(): row for row in rows}
    try:
        made = {key: Pose.from_vector(row) for key, row in known.items()}
    except ValueError as error:
        raise WrongRowsError("poses", f"X_WF of a pose of trial {trial}: {error}") from None
    return [made[row.tobytes()] for row in rows]


def _parts(column: pa.ChunkedArray) -> tuple[Any, Ints]:
    """The triples (n, 3) of all rows of a column of lists of triples, and where those of each row begin and end."""
    lists = column.combine_chunks()
    offsets = lists.offsets.to_numpy().astype(np.int64)
    return lists.flatten().flatten().to_numpy(zero_copy_only=False).reshape(-1, 3), offsets - offsets[0]
