"""The tables of one demonstration, checked by themselves and against one another before objects are made of them.

What passes is right by construction: every fragment has a parent, a closed mesh and a pose at every step at which it
exists, every cut divides a fragment that exists into those that name it as their parent, and the row of the table
`trials` counts what the others hold.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
import pyarrow as pa
from pydantic import Field, TypeAdapter, with_config
from typing_extensions import TypedDict

from cutgrammar.demonstration import CATEGORIES
from cutgrammar.geometry.arrays import Floats, Ints
from cutgrammar.untrusted import check
from cutgrammar.untrusted.kinds import STRICT, FoodName, Seed, Small, Word

MAX_DISTANCE = 100.0
"""Largest magnitude of a coordinate [m]."""
MAX_FRAGMENTS = 10_000
"""Most fragments of a demonstration, those of all steps together."""
MIN_VOLUME = 1e-12
"""Smallest volume of a fragment [m3]."""
MAY_BE_NULL = {"parent", "category", "undone_seconds"}
Rows = Mapping[str, list[Any]]
MAX_OBJECTS = 100


@with_config(STRICT)
class SummaryFacts(TypedDict):
    """A row of the table `trials`: see `tables.TrialSummary`."""

    trial: Small
    setup: Word
    foods: Annotated[list[FoodName], Field(min_length=1, max_length=MAX_OBJECTS)]
    categories: Annotated[list[Literal[CATEGORIES]], Field(min_length=1, max_length=len(CATEGORIES))]  # type: ignore[valid-type]
    demonstrator: Annotated[str, Field(pattern=r"^\w[\w .-]*$", max_length=100)]
    seed: Seed
    fragments: Annotated[int, Field(ge=1, le=MAX_FRAGMENTS)]
    cuts: Annotated[int, Field(ge=0, le=MAX_FRAGMENTS)]


_SUMMARY = TypeAdapter(SummaryFacts)


class WrongRowsError(ValueError):
    """Rows of one table are wrong.

    Attributes:
        table: its name.
    """

    def __init__(self, table: str, problem: str) -> None:
        super().__init__(problem)
        self.table = table


def check_summary(row: Mapping[str, Any], number: int) -> None:
    """Check a row of the table `trials`.

    Raises:
        WrongRowsError: a value is missing or out of bounds, or a category is repeated.
    """
    try:
        check(_SUMMARY, row)
    except ValueError as error:
        raise WrongRowsError("trials", f"row {number}: {error}") from None
    if len(set(row["categories"])) < len(row["categories"]):
        raise WrongRowsError("trials", f"row {number}: categories are repeated")


def check_columns(table: str, rows: pa.Table, trial: int) -> None:
    """Check that no value is missing, numbers are finite and in range, and all rows are of one trial.

    Raises:
        WrongRowsError: they are not; the message names the column.
    """
    for name in rows.column_names:
        values, is_whole = _flat(rows[name].combine_chunks())
        if not is_whole and name not in MAY_BE_NULL:
            raise WrongRowsError(table, f"{name} of trial {trial} is missing in a row")
        is_real = pa.types.is_floating(values.type)
        if not is_real and not pa.types.is_integer(values.type):
            continue
        numbers = (values if is_whole else values.drop_null()).to_numpy(zero_copy_only=False)
        if not len(numbers):
            continue
        bound = 1e10 if name.endswith("seconds") else MAX_DISTANCE
        if is_real and not (numbers.max() <= bound and numbers.min() >= -bound):
            raise WrongRowsError(
                table, f"{name} of trial {trial} holds numbers that are not finite or beyond {bound:g}"
            )
        if not is_real and numbers.min() < 0:
            raise WrongRowsError(table, f"{name} of trial {trial} is below 0 in a row")
    if set(rows["trial"].to_pylist()) - {trial}:
        raise WrongRowsError(table, f"trial of a row is another one among those of trial {trial}")


def check_references(summary: Any, tables: Mapping[str, pa.Table]) -> None:
    """Check what the rows of the tables of one demonstration say of one another.

    Args:
        summary: its row of the table `trials`.
        tables: the other tables, whose columns have been checked.

    Raises:
        WrongRowsError: they contradict one another; the message names the column.
    """
    trial = summary.trial
    fragments, poses, cuts = (
        {name: tables[table][name].to_pylist() for name in tables[table].column_names if name not in _LARGE}
        for table in ("fragments", "poses", "cuts")
    )
    _check_fragments(trial, fragments, len(summary.foods))
    undone = _check_cuts(trial, fragments, cuts)
    alive = _check_poses(trial, poses, cuts, undone, len(summary.foods))
    goal = [(i, fragments["category"][i]) for i in alive]
    if wrong := [i for i, category in enumerate(fragments["category"]) if category is not None and i not in alive]:
        raise WrongRowsError(
            "fragments", f"category of fragment {wrong[0]} of trial {trial}, which is not in the goal, is not empty"
        )
    strange = {category for _, category in goal if category is not None} - set(summary.categories)
    if strange:
        raise WrongRowsError(
            "fragments", f"category of a fragment of trial {trial} is {min(strange)}, which the trial does not have"
        )
    if summary.fragments != len(alive):
        raise WrongRowsError(
            "trials", f"fragments of trial {trial} are {summary.fragments}, but its goal has {len(alive)}"
        )
    made = sum(not is_undone for is_undone in cuts["undone"])
    if summary.cuts != made:
        raise WrongRowsError("trials", f"cuts of trial {trial} are {summary.cuts}, but {made} were made")
    if "strokes" in tables and tables["strokes"].num_rows:
        steps = tables["strokes"]["step"].to_pylist()
        if steps != cuts["step"]:
            raise WrongRowsError("strokes", f"step of a stroke of trial {trial} is not that of its cut")


def check_meshes(trial: int, vertices: Floats, of_vertices: Ints, faces: Ints, of_faces: Ints) -> None:
    """Check that the meshes of all fragments are closed and enclose a volume.

    Args:
        trial: for messages.
        vertices: (n, 3) of all fragments in their order [m].
        of_vertices: those of fragment i are from `of_vertices[i]` up to, without, `of_vertices[i + 1]`.
        faces: (m, 3) of all fragments; each counts the vertices of its own.
        of_faces: the same for faces.

    Raises:
        WrongRowsError: one is open, inside out, flat or empty, or a face names a vertex that there is not.
    """
    begins, counts, numbers = of_faces[:-1], np.diff(of_faces), np.diff(of_vertices)
    for few, name in ((numbers < 4, "vertices"), (counts < 4, "faces")):
        if few.any():
            raise WrongRowsError("fragments", f"{name} {_of(few, trial)} are too few for a closed mesh")
    largest = np.maximum.reduceat(faces.max(axis=1), begins)
    beyond = largest >= numbers
    if beyond.any():
        i = int(beyond.argmax())
        raise WrongRowsError("fragments", f"faces {_of(beyond, trial)} name vertex {largest[i]} of {numbers[i]}")
    a, b, c = (faces + np.repeat(of_vertices[:-1], counts)[:, None]).T
    if not _is_closed(a, b, c, len(vertices)):
        each = zip(np.split(faces, begins[1:]), numbers.tolist(), strict=True)
        is_open = np.array([not _is_closed(own[:, 0], own[:, 1], own[:, 2], number) for own, number in each])
        raise WrongRowsError("fragments", f"faces {_of(is_open, trial)} are no closed mesh")
    # Tetrahedra from a corner of the mesh itself, whose volumes are exact far from the origin, too.
    centred = vertices - np.repeat(vertices[of_vertices[:-1]], numbers, axis=0)
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (centred.take(corner, axis=0).T for corner in (a, b, c))
    parts = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    volumes = np.add.reduceat(parts, begins) / 6.0
    small = ~(volumes >= MIN_VOLUME)
    if small.any():
        volume = volumes[small.argmax()]
        wrong = "faces" if volume < -MIN_VOLUME else "vertices"
        raise WrongRowsError(
            "fragments", f"{wrong} {_of(small, trial)} enclose {volume * 1e6:.3g} ml; more than 0 is expected"
        )


def _of(wrong: Any, trial: int) -> str:
    """The first fragment of which it is true."""
    return f"of fragment {int(wrong.argmax())} of trial {trial}"


def _is_closed(a: Any, b: Any, c: Any, vertices: int) -> bool:
    """Whether each edge of the triangles a, b, c is one of another triangle in the other direction."""
    if (a == b).any() or (b == c).any() or (c == a).any():
        return False
    there = np.concatenate((a * vertices + b, b * vertices + c, c * vertices + a))
    back = np.concatenate((b * vertices + a, c * vertices + b, a * vertices + c))
    there.sort()
    back.sort()
    return np.array_equal(there, back)


_LARGE = ("vertices", "faces", "X_WF", "plane_W", "plane_C")


def _check_fragments(trial: int, rows: Rows, objects: int) -> None:
    ids = rows["fragment"]
    if ids != list(range(len(ids))) or not objects <= len(ids) <= MAX_FRAGMENTS or not objects:
        raise WrongRowsError("fragments", f"fragment of a row of trial {trial} is not its number, or there are too few")
    for i, (parent, step, category) in enumerate(zip(rows["parent"], rows["step"], rows["category"], strict=True)):
        if (parent is None) != (i < objects) or (parent is not None and parent >= i):
            raise WrongRowsError(
                "fragments",
                f"parent of fragment {i} of trial {trial} is {parent}; an earlier one, or none, is expected",
            )
        if (step == 0) != (i < objects):
            raise WrongRowsError(
                "fragments", f"step of fragment {i} of trial {trial} is {step}; only objects begin at 0"
            )
        if category is not None and category not in CATEGORIES:
            raise WrongRowsError(
                "fragments", f"category of fragment {i} of trial {trial} is none of {', '.join(CATEGORIES)}"
            )


def _check_cuts(trial: int, fragments: Rows, cuts: Rows) -> dict[int, bool]:
    """Check the cuts against the fragments; step -> whether it was undone."""
    produced: list[int] = []
    last = 0
    for step, fragment, products in zip(cuts["step"], cuts["fragment"], cuts["products"], strict=True):
        if step <= last:
            raise WrongRowsError("cuts", f"step of a cut of trial {trial} is {step} after {last}")
        last = step
        if fragment >= len(fragments["fragment"]):
            raise WrongRowsError(
                "cuts", f"fragment of the cut at step {step} of trial {trial} is {fragment}, which there is not"
            )
        if len(products) < 2 or len(set(products)) < len(products) or max(products) >= len(fragments["fragment"]):
            raise WrongRowsError(
                "cuts", f"products of the cut at step {step} of trial {trial} are not two or more of its fragments"
            )
        for product in products:
            if fragments["parent"][product] != fragment or fragments["step"][product] != step:
                raise WrongRowsError(
                    "cuts",
                    f"products of the cut at step {step} of trial {trial} are not of its fragment and step",
                )
        produced += products
    if without := [i for i, parent in enumerate(fragments["parent"]) if parent is not None and i not in set(produced)]:
        raise WrongRowsError("cuts", f"products of no cut of trial {trial} are fragment {without[0]}")
    return dict(zip(cuts["step"], cuts["undone"], strict=True))


def _check_poses(trial: int, poses: Rows, cuts: Rows, undone: Mapping[int, bool], objects: int) -> set[int]:
    """Check that exactly the fragments that exist have a pose at each step; return those of the last."""
    by_step: dict[int, list[int]] = {}
    for step, fragment in zip(poses["step"], poses["fragment"], strict=True):
        by_step.setdefault(step, []).append(fragment)
    last = max([*by_step, *cuts["step"]], default=0)
    if last > MAX_FRAGMENTS:
        raise WrongRowsError(
            "poses", f"step of a pose or cut of trial {trial} is {last}; at most {MAX_FRAGMENTS} are expected"
        )
    made = {step: (f, p) for step, f, p in zip(cuts["step"], cuts["fragment"], cuts["products"], strict=True)}
    alive, standing = set(range(objects)), list[int]()
    for step in range(last + 1):
        if step in made:
            fragment, products = made[step]
            if fragment not in alive:
                raise WrongRowsError(
                    "cuts",
                    f"fragment of the cut at step {step} of trial {trial} is {fragment}, which does not exist then",
                )
            alive = alive - {fragment} | set(products)
            standing.append(step)
        elif step:
            if not standing or not undone[standing[-1]]:
                raise WrongRowsError("cuts", f"step {step} of trial {trial} has no cut, and none before it was undone")
            fragment, products = made[standing.pop()]
            if not set(products) <= alive:
                raise WrongRowsError("cuts", f"undone of a cut of trial {trial} is true, but its products were cut")
            alive = alive - set(products) | {fragment}
        if sorted(by_step.get(step, [])) != sorted(alive):
            raise WrongRowsError(
                "poses", f"fragment of the poses at step {step} of trial {trial} are not those that exist then"
            )
    if wrong := [step for step in standing if undone[step]]:
        raise WrongRowsError(
            "cuts", f"undone of the cut at step {wrong[0]} of trial {trial} is true, but no later step undoes it"
        )
    return alive


def _flat(column: Any) -> tuple[Any, bool]:
    """The values of a column, those inside of lists too, and whether none is missing."""
    is_whole = not column.null_count
    while isinstance(column, pa.ListArray | pa.FixedSizeListArray):
        column = column.flatten()
        is_whole = is_whole and not column.null_count
    return column, is_whole
