"""Hostile ledgers, ratings and recordings of a run."""

import json
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from hostile.cases import Case, bytes_case, put
from hostile.documents import DEEP, ESCAPE, _fifo, _folder, _link
from hostile.good import unsafe_npz

LEDGER = "run/ledger.sqlite"
VIEW = "view run {trial} --save ../out/one.rrd"
ENDLESS = "WITH RECURSIVE c(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM c) SELECT {columns} FROM c"


def sql(folder: Path, *statements: str | tuple[str, tuple[Any, ...]]) -> None:
    """Carry out statements on the ledger."""
    connection = sqlite3.connect(folder / LEDGER)
    with connection:
        for statement in statements:
            connection.execute(*(statement if isinstance(statement, tuple) else (statement,)))
    connection.close()


def change_record(folder: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """Change the first record of the ledger."""
    connection = sqlite3.connect(folder / LEDGER)
    with connection:
        rowid, text = connection.execute("SELECT rowid, record FROM records ORDER BY rowid LIMIT 1").fetchone()
        record = json.loads(text)
        changed = change(record)
        text = json.dumps(record if changed is None else changed)
        connection.execute("UPDATE records SET record = ? WHERE rowid = ?", (text, rowid))
    connection.close()


def sql_case(name: str, *statements: str | tuple[str, tuple[Any, ...]], field: str = "", command: str = "") -> Case:
    """A case made by statements on the ledger."""
    named = ["ledger.sqlite", *([field] if field else [])]
    return Case("ledger", name, lambda folder: sql(folder, *statements), named, *([command] if command else []))


def record_case(path: list[str | int], value: Any, **options: Any) -> Case:
    """A case in which one value of a record is another."""

    def spoil(folder: Path) -> None:
        change_record(folder, lambda record: put(record, path, value))

    is_json = "NaN" not in json.dumps(value if value is not ... else 0) and "Infinity" not in json.dumps(
        value if value is not ... else 0
    )
    field = [str(part) for part in path if isinstance(part, str) and part.isidentifier()][-1:] if is_json else []
    name = f"record.{'.'.join(map(str, path))} = {'missing' if value is ... else repr(value)[:40]}"
    return Case("ledger", name, spoil, **{"named": ["ledger.sqlite", *field], **options})


def ledger_cases() -> Iterator[Case]:
    """All cases."""
    for path, values in (
        (["key", "setup"], ("../../../x", ESCAPE, None, 5, "", "x" * 100_000, "a/b", "a\x00b")),
        (["key", "method"], ("../x", ESCAPE, "<script>alert(1)</script>", None)),
        (["key", "trial"], (-1, "0", 1.5, 2**70, None, True)),
        (["key", "goals"], ("../x", "nowhere", ESCAPE)),
        (["key", "run"], (-1, 10**400, "x")),
        (["key", "world"], ("../x", ESCAPE)),
        (["key", "perception"], ("../x", ESCAPE)),
        (["key", "origin"], ("../x", ESCAPE, 7)),
        (["key", "unknown"], (1,)),
        (["key"], (None, [], "x", ...)),
        (["package"], (5, ESCAPE, None)),
        (["status"], ("lost", ESCAPE, None)),
        (["reason"], (5, [], "x" * 10_000_000)),
        (["traceback"], (5,)),
        (["scores"], (None, [], "x")),
        (["scores", "iou"], (1e6, -1, "0.5", True, [0.5], 1e400, float("nan"), float("inf"))),
        (["scores", "iou_strict"], (1e6, -0.5, "0.5", float("nan"))),
        (["scores", ESCAPE], (0.5,)),
        (["scores", "__class__.x"], (0.5,)),
        (["fragments"], (-1, 1.5, 10**30, "x")),
        (["goal_fragments"], (None, -1, 10**30)),
        (["cuts"], (None, -1, 10**30, "1", 1.5)),
        (["refusals"], (-1, None)),
        (["dead_ends"], (-1, None)),
        (["planning_seconds"], (None, -1, "x", float("inf"), 1e300)),
        (["seconds"], (None, -1, "x", float("nan"), 1e300)),
        (["events"], (None, {}, [None], [5], ["x"], [{}], [{"event": 5}], [{"event": "Exploded"}])),
        (["events", 0, "step"], ("x", -1, None, 10**30)),
        (["events", 0, "seconds"], ("x", float("nan"))),
        (["events", 0, "plane_W"], ([], "x", [1, 2], [float("inf")] * 4, None)),
        (["events", 0, "p_WC"], (5, [[1]], None)),
        (["events", 0, "production"], (5,)),
        (["events", 1, "products"], ("x", -1)),
        (["events", 1, "execution"], (5, {}, [], {"seconds": "x"})),
        (
            ["events", -1, "pairs"],
            (5, [5], [[0, 1]], [["a", "b", "c"]], [[0, 999, 0.5]], [[-1, 0, 0.5]], [[0, 0, 1e6]], [[0, 0, None]]),
        ),
        (["events", -1, "scores"], (None, {"iou": "x"})),
        (["model"], (5, ESCAPE)),
        (["unknown"], (5,)),
    ):
        for value in values:
            yield record_case(path, value)
    yield record_case(["reason"], ESCAPE, named=(), may_pass=True)
    yield record_case(["reason"], ESCAPE, named=(), may_pass=True, command="view run")
    yield Case(
        "ledger", "a setup with ../ that view writes to", _outside, ["ledger.sqlite", "setup"], VIEW.format(trial="../")
    )
    for name, text in (
        ("deep", "[" * DEEP + "]" * DEEP),
        ("an integer of 5,000 digits", "9" * 5000),
        ("null", "null"),
        ("a list", "[]"),
        ("empty", ""),
        ("no JSON", "x"),
        ("NaN", "NaN"),
        ("a lone surrogate", '{"a": "\\ud800"}'),
    ):
        yield sql_case(f"a record that is {name}", ("UPDATE records SET record = ?", (text,)))
    yield sql_case("a record that is bytes", ("UPDATE records SET record = ?", (b"\xff\xfe",)))
    yield sql_case("a record that is a number", "UPDATE records SET record = 5")
    yield sql_case("records that are not UTF-8", "UPDATE records SET record = CAST(x'ff7b7d' AS TEXT)")
    for column, value in (
        ("setup", "../x"),
        ("setup", ESCAPE),
        ("trial", "x"),
        ("trial", -1),
        ("trial", 1.5),
        ("run", "x"),
        ("method", ESCAPE),
        ("goals", "x"),
        ("setup", b"x"),
    ):
        yield sql_case(
            f"planned.{column} = {value!r}",
            (f"UPDATE planned SET {column} = ? WHERE rowid = 1", (value,)),
            field=column,
            command="show run",
        )
        yield sql_case(
            f"planned.{column} = {value!r}, report",
            (f"UPDATE planned SET {column} = ? WHERE rowid = 1", (value,)),
            field=column,
        )
    yield Case(
        "ledger",
        "an endless view of records",
        lambda folder: _view(folder, "records", "'x' AS key, '{}' AS record"),
        ["ledger.sqlite", "records"],
    )
    yield Case(
        "ledger",
        "an endless view of planned",
        lambda folder: _view(
            folder,
            "planned",
            "'k' AS key, 'N1M1' AS setup, n AS trial, 'in-place' AS goals, 'random' AS method, 0 AS run, "
            "'bench' AS world, 'truth' AS perception, 'o' AS origin",
        ),
        ["ledger.sqlite", "planned"],
    )
    yield Case(
        "ledger",
        "an endless view of configurations",
        lambda folder: _view(folder, "configurations", "'k' AS key, 'start' AS role, 'd' AS digest"),
        ["ledger.sqlite", "configurations"],
    )
    yield sql_case(
        "a view of a huge blob",
        "ALTER TABLE records RENAME TO r",
        "CREATE VIEW records AS SELECT key, setup, trial, goals, method, run, world, perception, origin, "
        "CAST(zeroblob(900000000) AS TEXT) AS record FROM r",
    )
    yield sql_case(
        "a generated column",
        "DROP TABLE contents",
        "CREATE TABLE contents (digest TEXT NOT NULL UNIQUE, content AS (zeroblob(900000000)))",
    )
    yield sql_case("a trigger", "CREATE TRIGGER t AFTER INSERT ON records BEGIN DELETE FROM records; END")
    yield sql_case("no table of records", "DROP TABLE records")
    yield sql_case("other columns", "DROP TABLE records", "CREATE TABLE records (a)")
    yield sql_case("an FTS table", "DROP TABLE contents", "CREATE VIRTUAL TABLE contents USING fts5(digest, content)")
    yield sql_case("another schema", "PRAGMA user_version = 99", field="schema")
    yield sql_case("another application", "PRAGMA application_id = 99")
    for name, content in (
        ("empty", b""),
        ("zeros", bytes(8192)),
        ("cut short", lambda old: old[:5000]),
        ("no database", b"hello" * 1000),
        ("bits flipped", lambda old: old[:100] + bytes(b ^ (i % 61 == 3) for i, b in enumerate(old[100:]))),
        ("a wrong page size", lambda old: old[:16] + b"\x00\x03" + old[18:]),
        ("a WAL header", lambda old: old[:18] + b"\x02\x02" + old[20:]),
        ("a huge page count", lambda old: old[:28] + b"\x7f\xff\xff\xff" + old[32:]),
    ):
        yield bytes_case("ledger", LEDGER, name, content)
    yield Case("ledger", "a FIFO", lambda folder: _fifo(folder / LEDGER), ["ledger.sqlite"])
    yield Case("ledger", "a folder", lambda folder: _folder(folder / LEDGER), ["ledger.sqlite"])
    yield Case("ledger", "endless", lambda folder: _link(folder / LEDGER, "/dev/zero"), ["ledger.sqlite"])
    yield Case("ledger", "a journal with the name of another file", _super_journal, ["ledger.sqlite"])
    trial = "N1M1"
    for name, content in (
        ("no archive", b"x"),
        (
            "objects",
            unsafe_npz(
                vertices=np.array([print], dtype=object),
                faces=np.zeros((1, 3)),
                counts=np.ones((1, 2)),
                rotations=np.eye(3)[None],
                positions=np.zeros((1, 3)),
            ),
        ),
        ("a bomb", _bomb),
        ("a declared shape of 10^15", _declared()),
        ("NaN", _arrays(vertices=np.full((3, 3), np.nan, dtype=np.float32))),
        ("a face beyond", _arrays(faces=np.full((1, 3), 99, dtype=np.uint32))),
        ("counts of others", _arrays(counts=np.array([[99, 99]], dtype=np.uint32))),
        ("no rotation", _arrays(rotations=np.zeros((1, 3, 3)))),
        ("a missing array", unsafe_npz(vertices=np.zeros((3, 3)))),
        ("text", _arrays(vertices=np.array([["a"] * 3] * 3))),
    ):
        yield Case(
            "ledger",
            f"configurations: {name}",
            lambda folder, content=content: sql(
                folder, ("UPDATE contents SET content = ?", (content if isinstance(content, bytes) else content(),))
            ),
            ["ledger.sqlite"],
        )
    yield sql_case("configurations: text", "UPDATE contents SET content = 'x'")
    yield sql_case("configurations: another role", "UPDATE configurations SET role = 'x' WHERE role = 'goal'")
    for name, spoil in (
        ("a FIFO", _fifo_recording),
        ("a folder", _folder_recording),
        ("endless", _endless_recording),
        ("recordings linked to another folder", _linked_recordings),
    ):
        yield Case(
            "recording",
            name,
            spoil,
            ["recordings"],
            VIEW.format(trial=f"{trial}-1-in-place-random"),
            may_pass=name.startswith("recordings"),
        )


def _recording(folder: Path) -> Path:
    (folder / "run/recordings").mkdir(exist_ok=True)
    return folder / "run/recordings/N1M1-1-in-place-random-0-bench-truth.rrd"


def _fifo_recording(folder: Path) -> None:
    import os

    os.mkfifo(_recording(folder))


def _folder_recording(folder: Path) -> None:
    _recording(folder).mkdir()


def _endless_recording(folder: Path) -> None:
    _recording(folder).symlink_to("/dev/zero")


def _linked_recordings(folder: Path) -> None:
    (folder.parent / "elsewhere").mkdir(exist_ok=True)
    (folder / "run/recordings").symlink_to(folder.parent / "elsewhere")


def _outside(folder: Path) -> None:
    change_record(folder, lambda record: record["key"].update(setup="../../../owned"))


def _view(folder: Path, table: str, columns: str) -> None:
    sql(
        folder,
        f"ALTER TABLE {table} RENAME TO old_{table}",
        f"CREATE VIEW {table} AS {ENDLESS.format(columns=columns)}",
    )


def _super_journal(folder: Path) -> None:
    """A hot journal that makes SQLite delete the file `victim`."""
    import random
    import struct

    victim = folder.parent / "elsewhere"
    victim.mkdir(exist_ok=True)
    (victim / "victim").write_bytes(b"/nonexistent-journal\x00")
    name = str(victim / "victim").encode()
    header = b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7" + struct.pack(
        ">IIIII", 0, random.Random(0).getrandbits(32), 3, 512, 4096
    )
    tail = struct.pack(">I", 1) + name + struct.pack(">II", len(name), sum(name)) + b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7"
    (folder / "run/ledger.sqlite-journal").write_bytes(header.ljust(512, b"\x00") + tail)


def _arrays(**changes: Any) -> bytes:
    arrays = {
        "vertices": np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=np.float32),
        "faces": np.array([[0, 1, 2]], dtype=np.uint32),
        "counts": np.array([[3, 1]], dtype=np.uint32),
        "rotations": np.eye(3)[None],
        "positions": np.zeros((1, 3)),
    }
    return unsafe_npz(**(arrays | changes))


def _bomb() -> bytes:
    """An archive of 1.2 GB of zeros in 1 MB."""
    import io
    import zipfile

    out, header = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f4", "fortran_order": False, "shape": (100_000_000, 3)})
    with zipfile.ZipFile(io.BytesIO(_arrays())) as old, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new:
        for name in old.namelist():
            if name != "vertices.npy":
                new.writestr(name, old.read(name))
        with new.open("vertices.npy", "w", force_zip64=True) as file:
            file.write(header.getvalue())
            for _ in range(1200):
                file.write(bytes(1_000_000))
    return out.getvalue()


def _declared() -> bytes:
    """An array that says that it has 10^15 rows."""
    import io
    import zipfile

    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(_arrays())) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "vertices.npy":
                header = io.BytesIO()
                np.lib.format.write_array_header_1_0(
                    header, {"descr": "<f4", "fortran_order": False, "shape": (10**15, 3)}
                )
                content = header.getvalue() + content[-36:]
            new.writestr(name, content)
    return out.getvalue()
