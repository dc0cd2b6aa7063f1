"""Random hostile inputs: good files of every reader, changed by rules that the lists of hand-made cases suggest."""

import dataclasses
import json
import math
import re
import sqlite3
import struct
import zlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pyarrow as pa

from cutgrammar.storage.ratings import Rating
from cutgrammar.storage.tables import SCHEMAS
from hostile.cases import READ, Case, sign
from hostile.documents import ESCAPE, FILES
from hostile.good import JOURNAL, RATINGS, sign_model
from hostile.ledger_cases import LEDGER, sql
from hostile.table_cases import change_rows
from hostile.tensor_cases import change_arrays

TEXTS = (
    "",
    "x",
    "../../x",
    "/etc/passwd",
    ESCAPE,
    "a" * 5000,
    "a\x00b",
    "\ud800",
    "N1M1",
    "grammar",
    "nan",
    "<script>",
    "%s%n",
    "{0}",
    "切り",
    "\u202e",
)
NUMBERS = (
    0,
    1,
    -1,
    2,
    7,
    255,
    2**31 - 1,
    2**31,
    2**53 + 1,
    2**63,
    2**70,
    10**400,
    0.5,
    -0.0,
    1e-320,
    1e300,
    -1e300,
    math.inf,
    -math.inf,
    math.nan,
    1_000_000_000,
)
TOKENS = (
    b"NaN",
    b"Infinity",
    b"-1e999",
    b"9" * 5000,
    b"1e999",
    b"[" * 300 + b"]" * 300,
    b"[" * 20_000,
    b"null",
    b"true",
    b'"\\ud800"',
    b"{}",
    b"\xff\xfe",
    b"\x00",
    b"1_000",
    b"0x10",
    b"01",
)
SHARES = {
    "manifest": 2,
    "tables": 4,
    "split": 1,
    "model": 2,
    "tensors": 3,
    "grammar": 2,
    "run": 2,
    "ledger": 4,
    "settings": 2,
    "study": 1,
    "urdf": 1,
    "mesh": 0.5,
    "ratings": 1,
    "journal": 1,
    "trajectory": 1,
    "demonstration page": 2,
    "rating page": 1,
}
"""Relative numbers of inputs of each reader; those of meshes start a process each."""
REPORT, SHOW_RUN = READ["run"], "show run"
EVALUATE = (
    "evaluate --data data --model model --out ../out/run --methods {method} --world bench --trials 1 --runs 1 "
    "--workers 0"
)
COMMANDS = {
    "manifest": ("show data", "split data --out data --rule share", EVALUATE.format(method="random")),
    "tables": ("show data", "show data", EVALUATE.format(method="random")),
    "split": ("show data", EVALUATE.format(method="random")),
    "model": ("show model", EVALUATE.format(method="random")),
    "tensors": ("show model", EVALUATE.format(method="bc")),
    "grammar": ("show model", EVALUATE.format(method="random")),
    "run": (REPORT, SHOW_RUN, "view run", "view run --compare random largest"),
    "ledger": (REPORT, SHOW_RUN, "view run", REPORT),
    "settings": (READ["settings"],),
    "study": (READ["study"],),
    "urdf": (READ["urdf"],),
}


def mutated(seed: int, number: int, reader: str) -> Case:
    """Random input `number` of a reader; the same for the same seed.

    Those of pages are given `page_requests.Pages` instead of a folder.
    """
    rng = Random(f"{seed}-{reader}-{number}")
    if reader.endswith(" page"):
        return Case(reader, f"{number}", lambda pages: pages.request(reader, rng, _message), may_pass=True)
    file, change = _CHANGES[reader](rng)
    command = f"{READ['mesh']} {file}" if reader == "mesh" else rng.choice(COMMANDS.get(reader, ("",)))

    def spoil(folder: Path) -> None:
        change(folder)

    return Case(reader, f"{file} {number}", spoil, (), command, may_pass=True)


def _message(rng: Random, message: Any) -> bytes:
    """A changed message to a page."""
    if rng.random() < 0.25:
        return json.dumps(message).encode() if rng.random() < 0.4 else change_bytes(rng, json.dumps(message).encode())
    return json.dumps(change_tree(rng, message)).encode()


def value(rng: Random, depth: int = 0) -> Any:
    """A random value of any type."""
    kind = rng.random() * (1.0 if depth < 2 else 0.7)
    if kind < 0.35:
        return rng.choice(NUMBERS)
    if kind < 0.6:
        return rng.choice(TEXTS)
    if kind < 0.7:
        return rng.choice((None, True, False))
    if kind < 0.85:
        return [value(rng, depth + 1) for _ in range(rng.choice((0, 1, 2, 3, 4, 7, 50)))]
    if kind < 0.95:
        return {str(rng.choice(TEXTS)): value(rng, depth + 1) for _ in range(rng.randrange(3))}
    deep: Any = 1
    for _ in range(rng.choice((5, 150, 190, 300, 600))):  # Python writes no more than about 900 levels
        deep = [deep] if rng.random() < 0.5 else {"a": deep}
    return deep


def places(tree: Any) -> list[tuple[Any, Any]]:
    """All (container, name or number) in nested lists and dictionaries."""
    found, pending = [], [tree]
    while pending:
        at = pending.pop()
        for name, inner in at.items() if isinstance(at, dict) else enumerate(at) if isinstance(at, list) else ():
            found.append((at, name))
            pending.append(inner)
    return found


def change_tree(rng: Random, tree: Any) -> Any:
    """Change a random place of nested data, or several."""
    for _ in range(rng.choice((1, 1, 1, 2, 5))):
        known = places(tree)
        if not known:
            return value(rng)
        at, name = rng.choice(known)
        kind = rng.random()
        if kind < 0.6:
            at[name] = value(rng)
        elif kind < 0.75:
            del at[name]
        elif kind < 0.85 and isinstance(at, list):
            at += at[name : name + 1] * rng.choice((1, 2, 100))
        elif kind < 0.95 and isinstance(at, dict):
            at[str(rng.choice(TEXTS))] = at.pop(name) if rng.random() < 0.5 else value(rng)
        else:
            other, there = rng.choice(known)
            at[name] = (
                json.loads(json.dumps(other[there]))
                if there in (other if isinstance(other, dict) else range(len(other)))
                else None
            )
    return tree


def change_bytes(rng: Random, content: bytes) -> bytes:
    """Cut, flip, repeat or replace bytes, or put a token in."""
    kind = rng.randrange(6)
    at = rng.randrange(len(content) + 1)
    if kind == 0:
        return content[:at]
    if kind == 1:
        changed = bytearray(content)
        for _ in range(rng.choice((1, 1, 3, 30))):
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
        return bytes(changed)
    if kind == 2:
        return content[:at] + rng.choice(TOKENS) + content[at:]
    if kind == 3:
        numbers = list(re.finditer(rb"-?\d+(\.\d+)?", content))
        if numbers:
            found = rng.choice(numbers)
            return content[: found.start()] + rng.choice(TOKENS) + content[found.end() :]
    if kind == 4:
        return content[:at] + content[at : at + 200] * rng.choice((2, 50)) + content[at:]
    return content[:at] + rng.randbytes(rng.choice((1, 4, 64))) + content[at + rng.choice((0, 4, 64)) :]


def _json_file(file: str) -> Callable[[Random], tuple[str, Callable[[Path], None]]]:
    def make(rng: Random) -> tuple[str, Callable[[Path], None]]:
        def change(folder: Path) -> None:
            target = folder / file
            if rng.random() < 0.2:
                target.write_bytes(change_bytes(rng, target.read_bytes()))
            else:
                target.write_text(json.dumps(change_tree(rng, json.loads(target.read_bytes()))))
            if rng.random() < 0.9:
                sign(folder, file)

        return file, change

    return make


def _table(rng: Random) -> tuple[str, Callable[[Path], None]]:
    table = rng.choice(list(SCHEMAS))
    file = f"data/{table}/part-00000.parquet"

    def change(folder: Path) -> None:
        if rng.random() < 0.25:
            target = folder / file
            target.write_bytes(change_bytes(rng, target.read_bytes()))
            sign(folder, file)
            return
        change_rows(folder, table, lambda rows: _changed_rows(rng, table, rows), trial=rng.randrange(6))

    return file, change


def _changed_rows(rng: Random, table: str, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    schema = SCHEMAS[table]
    for _ in range(rng.choice((1, 1, 1, 3))):
        kind = rng.random()
        if not rows:
            return rows
        row = rng.randrange(len(rows))
        if kind < 0.7:
            name = rng.choice(schema.names)
            rows[row] = {**rows[row], name: _cell(rng, schema.field(name).type, rows[row][name])}
        elif kind < 0.8:
            del rows[row]
        elif kind < 0.9:
            rows.insert(rng.randrange(len(rows)), dict(rows[row]))
        else:
            other = rng.randrange(len(rows))
            rows[row], rows[other] = rows[other], rows[row]
    return rows


def _cell(rng: Random, kind: Any, old: Any) -> Any:
    """A random value that a column of this type can hold."""
    if rng.random() < 0.1:
        return None
    if pa.types.is_integer(kind):
        bits = kind.bit_width - 1
        return rng.choice((0, 1, 2, -1, 5, 1000, 2**bits - 1, -(2**bits)))
    if pa.types.is_floating(kind):
        return rng.choice([float(number) for number in NUMBERS if abs(number) < 10**300 or isinstance(number, float)])
    if pa.types.is_boolean(kind):
        return rng.random() < 0.5
    if pa.types.is_string(kind):
        return rng.choice([text for text in TEXTS if text != "\ud800"])
    if pa.types.is_fixed_size_list(kind):
        return (
            [_cell(rng, kind.value_type, None) or 0 for _ in range(kind.list_size)]
            if old is None or rng.random() < 0.5
            else [_cell(rng, kind.value_type, None) or 0.0 if rng.random() < 0.3 else number for number in old]
        )
    if old and rng.random() < 0.7:
        changed = list(old)
        at = rng.randrange(len(changed))
        if rng.random() < 0.3:
            del changed[at]
        else:
            changed[at] = _cell(rng, kind.value_type, changed[at])
        return changed
    return [_cell(rng, kind.value_type, None) for _ in range(rng.choice((0, 1, 3)))]


def _tensor(rng: Random) -> tuple[str, Callable[[Path], None]]:
    network = rng.choice(("encoder", "classifier", "planes", "bc", "qnet", "goal_planes"))
    file = f"model/{network}.safetensors"

    def change(folder: Path) -> None:
        kind = rng.random()
        target = folder / file
        if kind < 0.2:
            target.write_bytes(change_bytes(rng, target.read_bytes()))
            sign_model(folder / "model")
        elif kind < 0.35:
            content = target.read_bytes()
            length = struct.unpack_from("<Q", content)[0]
            header = json.dumps(change_tree(rng, json.loads(content[8 : 8 + length]))).encode()
            target.write_bytes(struct.pack("<Q", len(header)) + header + content[8 + length :])
            sign_model(folder / "model")
        else:
            change_arrays(folder, network, lambda arrays: _changed_arrays(rng, arrays))

    return file, change


def _changed_arrays(rng: Random, arrays: dict[str, Any]) -> dict[str, Any]:
    for _ in range(rng.choice((1, 1, 2))):
        if not arrays:
            return arrays
        name = rng.choice(sorted(arrays))
        kind, array = rng.randrange(7), arrays[name]
        if kind <= 1 and array.size and array.dtype == np.float64:
            array = array.copy()
            array.flat[rng.randrange(array.size)] = float(
                rng.choice([n for n in NUMBERS if isinstance(n, float) or abs(n) < 10**300])
            )
            arrays[name] = array
        elif kind == 2:
            del arrays[name]
        elif kind == 3:
            arrays[f"{name}{rng.choice(('', 'x', '.', '0'))}{rng.randrange(3)}"] = array
        elif kind == 4:
            arrays[name] = np.zeros([rng.choice((0, 1, 2, 8, 17)) for _ in range(rng.randrange(4))])
        elif kind == 5:
            arrays[name] = (
                np.nan_to_num(array)
                .clip(-100, 100)
                .astype(rng.choice((np.float32, np.float16, np.int8, np.int64, np.bool_)))
            )
        else:
            arrays[name] = array.reshape(-1) if rng.random() < 0.5 else np.ascontiguousarray(array.T)
    return arrays


def _ledger(rng: Random) -> tuple[str, Callable[[Path], None]]:
    def change(folder: Path) -> None:
        kind = rng.random()
        if kind < 0.6:
            connection = sqlite3.connect(folder / LEDGER)
            rows = connection.execute("SELECT rowid, record FROM records").fetchall()
            rowid, text = rng.choice(rows)
            if rng.random() < 0.15:
                changed: Any = change_bytes(rng, text.encode()).decode("utf-8", "replace")
            else:
                changed = json.dumps(change_tree(rng, json.loads(text)))
            with connection:
                connection.execute("UPDATE records SET record = ? WHERE rowid = ?", (changed, rowid))
            connection.close()
        elif kind < 0.75:
            table, columns = rng.choice(
                (
                    ("planned", ("setup", "trial", "goals", "method", "run", "world", "perception", "origin", "key")),
                    ("configurations", ("key", "role", "digest")),
                    ("contents", ("digest",)),
                    ("records", ("key", "record")),
                )
            )
            given = rng.choice(
                (
                    *(t for t in TEXTS if t != "\ud800"),
                    *(n for n in NUMBERS if isinstance(n, float) or abs(n) < 2**63),
                    b"x",
                )
            )
            if isinstance(given, float) and math.isnan(given):
                given = 0.25
            sql(
                folder,
                (
                    f"UPDATE {table} SET {rng.choice(columns)} = ? WHERE rowid = (SELECT min(rowid) FROM {table})",
                    (given,),
                ),
            )
        elif kind < 0.85:
            connection = sqlite3.connect(folder / LEDGER)
            digest, content = rng.choice(connection.execute("SELECT digest, content FROM contents").fetchall())
            with connection:
                connection.execute(
                    "UPDATE contents SET content = ? WHERE digest = ?", (change_bytes(rng, content), digest)
                )
            connection.close()
        else:
            target = folder / LEDGER
            target.write_bytes(change_bytes(rng, target.read_bytes()))

    return LEDGER, change


def _toml(file: str) -> Callable[[Random], tuple[str, Callable[[Path], None]]]:
    def make(rng: Random) -> tuple[str, Callable[[Path], None]]:
        def change(folder: Path) -> None:
            target = folder / file
            text = target.read_bytes()
            if rng.random() < 0.4:
                target.write_bytes(change_bytes(rng, text))
                return
            lines = text.decode().splitlines()
            for _ in range(rng.choice((1, 2))):
                at = rng.randrange(1, len(lines))
                name = lines[at].partition("=")[0].strip() if "=" in lines[at] and rng.random() < 0.8 else "unknown"
                lines[at] = f"{name} = {_toml_value(rng, value(rng))}"
            target.write_bytes("\n".join(lines).encode("utf-8", "surrogatepass"))

        return file, change

    return make


def _toml_value(rng: Random, given: Any) -> str:
    if isinstance(given, bool):
        return str(given).lower()
    if isinstance(given, int | float):
        return str(given)
    if isinstance(given, list):
        depth, text = 0, given
        while isinstance(text, list) and len(text) == 1:
            depth, text = depth + 1, text[0]
        inner = ", ".join(_toml_value(rng, x) for x in (text if isinstance(text, list) else [text]))
        return "[" * (depth + 1) + inner + "]" * (depth + 1)
    if isinstance(given, dict):
        return "{ a = 1 }"
    if given is None:
        return rng.choice(("1979-05-27", "07:32:00", "inf", "nan", "0x10", "1_000", "''"))
    return json.dumps(given)


def _urdf(rng: Random) -> tuple[str, Callable[[Path], None]]:
    def change(folder: Path) -> None:
        target = folder / "arm.urdf"
        text = target.read_bytes()
        kind = rng.random()
        if kind < 0.3:
            target.write_bytes(change_bytes(rng, text))
            return
        attributes = list(re.finditer(rb'"([^"]*)"', text))
        for _ in range(rng.choice((1, 2))):
            found = rng.choice(attributes)
            given = rng.choice((*map(str, NUMBERS), *TEXTS, "0 0", "0 0 0 0", "1e5 1e5 1e5", "-1", "1e-9"))
            given = re.sub(r"[<>&\"\x00-\x1f\ud800]", "", given)[:300]
            text = text[: found.start(1)] + given.encode() + text[found.end(1) :]
            attributes = list(re.finditer(rb'"([^"]*)"', text))
        if kind > 0.9:
            elements = list(re.finditer(rb"<(joint|link)\b.*?</\1>", text, re.DOTALL))
            found = rng.choice(elements)
            text = text[: found.start()] + (found.group() * 2 if rng.random() < 0.5 else b"") + text[found.end() :]
        target.write_bytes(text)

    return "arm.urdf", change


def _mesh(rng: Random) -> tuple[str, Callable[[Path], None]]:
    file = f"box.{rng.choice(('stl', 'obj', 'ply', 'glb'))}"

    def change(folder: Path) -> None:
        target = folder / file
        target.write_bytes(change_bytes(rng, target.read_bytes()))

    return file, change


def _ratings(rng: Random) -> tuple[str, Callable[[Path], None]]:
    def change(folder: Path) -> None:
        target = folder / RATINGS
        if rng.random() < 0.3:
            target.write_bytes(change_bytes(rng, target.read_bytes()))
            return
        connection = sqlite3.connect(target)
        connection.execute("PRAGMA ignore_check_constraints = ON")
        name = rng.choice([field.name for field in dataclasses.fields(Rating)])
        given = rng.choice((*(t for t in TEXTS if t != "\ud800"), *(n for n in NUMBERS if abs(n) < 2**63), None, b"x"))
        with connection, suppress(sqlite3.Error):  # some values no table of these types takes
            connection.execute(f"UPDATE ratings SET {name} = ? WHERE rowid = 1", (given,))
        connection.close()

    return RATINGS, change


def _journal(rng: Random) -> tuple[str, Callable[[Path], None]]:
    def change(folder: Path) -> None:
        target = folder / JOURNAL
        lines = [line.partition(b" ")[2].rstrip(b"\n") for line in target.read_bytes().splitlines(keepends=True)]
        if rng.random() < 0.2:
            target.write_bytes(change_bytes(rng, target.read_bytes()))
            return
        at = rng.randrange(len(lines))
        entry = change_tree(rng, json.loads(lines[at]))
        lines[at] = json.dumps(entry).encode() if rng.random() < 0.8 else change_bytes(rng, lines[at])
        if rng.random() < 0.2:
            rng.shuffle(lines)
        target.write_bytes(b"".join(b"%08x %s\n" % (zlib.crc32(line), line) for line in lines))

    return JOURNAL, change


_CHANGES = {
    **{reader: _json_file(file) for reader, file in FILES.items()},
    "tables": _table,
    "tensors": _tensor,
    "ledger": _ledger,
    "settings": _toml("settings.toml"),
    "study": _toml("study.toml"),
    "urdf": _urdf,
    "mesh": _mesh,
    "ratings": _ratings,
    "journal": _journal,
    "trajectory": _json_file("trajectory.json"),
}


def counts(total: int, readers: Sequence[str] = ()) -> dict[str, int]:
    """How many of `total` inputs each reader gets."""
    shares = {reader: share for reader, share in SHARES.items() if not readers or reader in readers}
    return {reader: round(total * share / sum(shares.values())) for reader, share in shares.items()}
