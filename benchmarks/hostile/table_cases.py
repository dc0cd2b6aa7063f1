"""Hostile tables of a data set, with digests made anew: values, references between tables, and Parquet itself."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from cutgrammar.storage.tables import SCHEMAS
from hostile.cases import Case, bytes_case
from hostile.documents import ESCAPE, _fifo, _link
from hostile.good import sign_data

Rows = list[dict[str, Any]]


def change_rows(folder: Path, table: str, change: Callable[[Rows], Rows | None], trial: int = 0) -> None:
    """Change the rows of one trial of a table; the digests are made anew."""
    file = folder / f"data/{table}/part-00000.parquet"
    with pq.ParquetFile(file) as parquet:
        groups = [parquet.read_row_group(i).to_pylist() for i in range(parquet.num_row_groups)]
    changed = change(groups[trial])
    groups[trial] = groups[trial] if changed is None else changed
    with pq.ParquetWriter(file, SCHEMAS[table], compression="zstd", use_dictionary=False) as writer:
        for rows in groups:
            columns = {name: [row[name] for row in rows] for name in SCHEMAS[table].names}
            writer.write_table(pa.table(columns, schema=SCHEMAS[table]), row_group_size=max(1, len(rows)))
    sign_data(folder / "data")


def cell(table: str, row: int, column: str, value: Any, **options: Any) -> Case:
    """A case in which one cell has another value."""

    def spoil(folder: Path) -> None:
        change_rows(folder, table, lambda rows: rows[row].update({column: value}))

    is_list = value == [None] or (value is None and column in ("X_WF", "plane_W", "plane_C"))
    file = "part-00000.parquet" if (column, value) == ("step", 10**6) else f"{table}/part-00000.parquet"
    named = [file, *([] if is_list and column not in ("foods",) else [column])]
    return Case("tables", f"{table}[{row}].{column} = {repr(value)[:40]}", spoil, **{"named": named, **options})


def table_cases() -> Iterator[Case]:
    """All cases."""
    for column, values in {
        "trial": (None, -1, 7),
        "setup": (None, "", "../../x", ESCAPE, "x" * 10_000, "a/b"),
        "foods": (None, [], [None], [ESCAPE], ["a"] * 1000, ["../x"]),
        "categories": (None, [], ["bricks"], ["chunks", "chunks"], [ESCAPE]),
        "demonstrator": (None, ESCAPE, "x" * 100_000),
        "seed": (None, -5),
        "fragments": (None, -1, 10**9, 1),
        "cuts": (None, -1, 10**9, 0),
    }.items():
        for value in values:
            yield cell("trials", 0, column, value)
    for row, column, values in (
        (1, "trial", (None, 3)),
        (1, "fragment", (None, 0, -1, 10**6)),
        (1, "parent", (None, -1, 99, 1, 5)),
        (1, "step", (None, -1, 0, 10**6)),
        (0, "parent", (0,)),
        (0, "step", (1,)),
        (-1, "category", ("bricks", ESCAPE, "")),
        (0, "vertices", (None, [], [[0.0, 0.0, 0.0]], [None])),
        (0, "faces", (None, [], [[0, 1, 2]], [[0, 0, 0]], [[0, 1, 10**6]], [[-1, 0, 1]], [None])),
    ):
        for value in values:
            yield cell("fragments", row, column, value)
    for name, change, word in (
        ("a vertex that is NaN", lambda rows: rows[0]["vertices"][0].__setitem__(0, float("nan")), "vertices"),
        ("a vertex at infinity", lambda rows: rows[0]["vertices"][0].__setitem__(0, float("inf")), "vertices"),
        ("a vertex a light year away", lambda rows: rows[0]["vertices"][0].__setitem__(0, 1e16), "vertices"),
        ("an open mesh", lambda rows: rows[0].update(faces=rows[0]["faces"][1:]), "faces"),
        ("a mesh inside out", lambda rows: rows[0].update(faces=[f[::-1] for f in rows[0]["faces"]]), "faces"),
        (
            "a flat mesh",
            lambda rows: rows[0].update(vertices=[[x, y, 0.0] for x, y, _ in rows[0]["vertices"]]),
            "vertices",
        ),
        (
            "a microscopic mesh",
            lambda rows: rows[0].update(vertices=[[x * 1e-9 for x in v] for v in rows[0]["vertices"]]),
            "vertices",
        ),
        ("a missing fragment", lambda rows: rows[:-1], "fragment"),
        ("no fragments", lambda _: [], "fragment"),
        ("a goal fragment without a category", lambda rows: rows[-1].update(category=None), "category"),
        ("a category on what was cut", lambda rows: rows[0].update(category="chunks"), "category"),
    ):
        yield Case(
            "tables",
            f"fragments: {name}",
            lambda folder, change=change: change_rows(folder, "fragments", change),
            ["part-00000.parquet" if name == "a missing fragment" else "fragments/part-00000.parquet", word],
            may_pass=name == "a goal fragment without a category",
        )
    for column, values in {
        "trial": (None, 9),
        "step": (None, -1, 10**6),
        "fragment": (None, -1, 10**6),
        "X_WF": (
            None,
            [float("nan")] * 7,
            [0.0] * 7,
            [1e300] * 7,
            [float("inf"), 0, 0, 1, 0, 0, 0],
            [1e9, 0, 0, 1, 0, 0, 0],
            [0, 0, 0, 5e100, 0, 0, 0],
        ),
    }.items():
        for value in values:
            yield cell("poses", 0, column, value)
    for name, change in (
        ("a missing pose", lambda rows: rows[1:]),
        ("no poses", lambda _: []),
        ("a pose twice", lambda rows: [*rows, rows[-1]]),
        ("a last step without poses", lambda rows: [row for row in rows if row["step"] < rows[-1]["step"]]),
        ("a step without poses", lambda rows: [row for row in rows if row["step"] != 1]),
        ("a fragment that was cut", lambda rows: [*rows, {**rows[-1], "fragment": 0}]),
    ):
        yield Case(
            "tables",
            f"poses: {name}",
            lambda folder, change=change: change_rows(folder, "poses", change),
            ["poses/part-00000.parquet"],
        )
    for column, values in {
        "trial": (None, 9),
        "step": (None, 0, -1, 99, 10**9),
        "fragment": (None, -1, 99, 10**9),
        "products": (None, [], [1], [None, 2], [1, 1], [0, 1], [98, 99], [1, 2, 3]),
        "undone": (None, True),
        "plane_W": (None, [0.0] * 4, [1e300] * 4, [float("nan")] * 4, [1.0, 0, 0, float("inf")], [1.0, 0, 0, 1e12]),
        "plane_C": (None, [0.0] * 4, [5.0, 0, 0, 0]),
    }.items():
        for value in values:
            yield cell("cuts", 0, column, value)
    for name, change in (
        ("a missing cut", lambda rows: rows[1:]),
        ("no cuts", lambda _: []),
        ("a cut twice", lambda rows: [*rows, rows[-1]]),
        ("cuts backwards", lambda rows: rows[::-1]),
    ):
        yield Case(
            "tables",
            f"cuts: {name}",
            lambda folder, change=change: change_rows(folder, "cuts", change),
            ["part-00000.parquet"],
            may_pass=name == "cuts backwards",
        )
    for table in SCHEMAS:
        file = f"data/{table}/part-00000.parquet"
        for name, content in (
            ("empty", b""),
            ("zeros", bytes(500)),
            ("cut short", lambda old: old[: len(old) // 2]),
            ("without its end", lambda old: old[:-50]),
            ("a footer of 2 GB", lambda old: old[:-8] + b"\xff\xff\xff\x7fPAR1"),
            ("bits flipped", lambda old: bytes(b ^ (i % 97 == 3) for i, b in enumerate(old))),
        ):
            yield bytes_case("tables", file, name, content, named=[f"{table}/part-00000.parquet"])
        yield Case(
            "tables",
            f"{table}: a FIFO",
            lambda folder, file=file: _fifo(folder / file),
            [f"{table}/part-00000.parquet"],
        )
        yield Case(
            "tables",
            f"{table}: endless",
            lambda folder, file=file: _link(folder / file, "/dev/zero"),
            [f"{table}/part-00000.parquet"],
        )
    for table, column in (("fragments", b"parent"), ("trials", b"seed"), ("poses", b"step"), ("cuts", b"undone")):
        yield bytes_case(
            "tables",
            f"data/{table}/part-00000.parquet",
            f"a footer that kills pyarrow at {column.decode()}",
            lambda old, column=column: deadly(old, column),
            named=[f"{table}/part-00000.parquet"],
        )
    yield Case("tables", "a bomb of 4 GB", _bomb, ["fragments/part-00000.parquet"])
    yield Case("tables", "a dictionary bomb", _dictionary_bomb, ["fragments/part-00000.parquet"])
    yield Case(
        "tables", "other columns", lambda folder: _other(folder, {"a": pa.array([1])}), ["trials/part-00000.parquet"]
    )
    yield Case(
        "tables",
        "a column with escapes",
        lambda folder: _other(folder, {ESCAPE: pa.array([1])}),
        ["trials/part-00000.parquet"],
    )


def deadly(content: bytes, column: bytes) -> bytes:
    """A part whose footer gives a column a repetition that does not exist, at which pyarrow ends the process."""
    name = b"\x18" + bytes([len(column)]) + column
    changed = content.replace(b"\x25\x02" + name, b"\x25\x03" + name, 1)
    if changed == content:
        raise ValueError(f"the footer has no column {column.decode()} as it was written by pyarrow 25")
    return changed


def _other(folder: Path, columns: dict[str, Any]) -> None:
    pq.write_table(pa.table(columns), folder / "data/trials/part-00000.parquet")
    sign_data(folder / "data")


def _bomb(folder: Path) -> None:
    """160 million vertices, which are all zero, in some kB."""
    file = folder / "data/fragments/part-00000.parquet"
    import numpy as np

    schema, count = SCHEMAS["fragments"], 20_000_000
    zeros = pa.array(np.zeros(3 * count))
    kind = schema.field("vertices").type
    inner = pa.FixedSizeListArray.from_arrays(zeros, type=kind.value_type)
    vertices = pa.ListArray.from_arrays(pa.array([0, count], pa.int32()), inner, type=kind)
    rest = {"trial": [0], "fragment": [0], "parent": [None], "step": [0], "category": [None], "faces": [[[0, 1, 2]]]}
    columns = [vertices if n == "vertices" else pa.array(rest[n], schema.field(n).type) for n in schema.names]
    table = pa.Table.from_arrays(columns, schema=schema)
    with pq.ParquetWriter(file, schema, compression="zstd", use_dictionary=False) as writer:
        for _ in range(6):
            writer.write_table(table)
    sign_data(folder / "data")


def _dictionary_bomb(folder: Path) -> None:
    """200 million equal vertices, encoded as one value and its number of repetitions."""
    import numpy as np

    file, schema, count = folder / "data/fragments/part-00000.parquet", SCHEMAS["fragments"], 30_000_000
    kind = schema.field("vertices").type
    inner = pa.FixedSizeListArray.from_arrays(pa.array(np.ones(3 * count)), type=kind.value_type)
    vertices = pa.ListArray.from_arrays(pa.array([0, count], pa.int32()), inner, type=kind)
    rest = {"trial": [0], "fragment": [0], "parent": [None], "step": [0], "category": [None], "faces": [[[0, 1, 2]]]}
    columns = [vertices if n == "vertices" else pa.array(rest[n], schema.field(n).type) for n in schema.names]
    table = pa.Table.from_arrays(columns, schema=schema)
    with pq.ParquetWriter(file, schema, compression="none", use_dictionary=True) as writer:
        for _ in range(6):
            writer.write_table(table)
    sign_data(folder / "data")
