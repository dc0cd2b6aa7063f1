"""Random hostile inputs: good files of every reader, changed by rules that the lists of hand-made cases suggest."""

import dataclasses
import json
import math
import re
import sqlite3
import zlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

from cutgrammar.storage.attempts import COLUMNS as ATTEMPTS
from cutgrammar.storage.ratings import Rating
from hostile.cases import READ, Case, sign
from hostile.documents import FILES
from hostile.good import JOURNAL, RATINGS, RECORDED, RECORDINGS
from hostile.ledger_cases import LEDGER, sql
from hostile.random_columns import Change, change_table, change_tensor
from hostile.random_values import NUMBERS, TEXTS, change_bytes, change_plausibly, change_tree, value

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
    "attempts": 1,
    "recording": 0.1,
    "import": 0.2,
    "ratings": 1,
    "journal": 1,
    "trajectory": 1,
    "demonstration page": 2,
    "rating page": 1,
}
"""Relative numbers of inputs of each reader; those of meshes, recordings and imports start processes."""
REPORT, SHOW_RUN = READ["run"], "show run"
EVALUATE = (
    "evaluate --data data --model model --out ../out/run --methods {method} --world bench --trials 1 --runs 1 "
    "--workers 0"
)
STILLS = "film run N1M1-1-in-place-random --stills ../out/stills.png"
RESUME = (
    "evaluate --data data --model model --out run --methods random largest --world bench --runs 1 --trials 2 "
    "--workers 0 --retry crashed failed"
)
COMMANDS = {
    "manifest": ("show data", "split data --out data --rule share", EVALUATE.format(method="random")),
    "tables": ("show data", "show data", EVALUATE.format(method="random")),
    "split": ("show data", EVALUATE.format(method="random")),
    "model": ("show model", EVALUATE.format(method="random")),
    "tensors": ("show model", EVALUATE.format(method="bc")),
    "grammar": ("show model", EVALUATE.format(method="random")),
    "run": (REPORT, SHOW_RUN, "view run", "view run --compare random largest --save ../out/one.rrd", STILLS),
    "ledger": (REPORT, SHOW_RUN, "view run", REPORT, STILLS),
    "attempts": (REPORT, SHOW_RUN, "sync run", RESUME),
    "recording": (
        "view run --compare random largest --save ../out/one.rrd",
        "view run --worst 2 --save ../out/one.rrd",
        "view run N1M1-1-in-place-random --save ../out/one.rrd",
    ),
    "import": (f"import {RECORDED} --out ../out/data",),
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
        return Case(reader, f"{number}", lambda pages: pages.request(reader, rng, changed_message), may_pass=True)
    file, change = _CHANGES[reader](rng)
    command = f"{READ['mesh']} {file}" if reader == "mesh" else rng.choice(COMMANDS.get(reader, ("",)))

    def spoil(folder: Path) -> None:
        change(folder)

    return Case(reader, f"{file} {number}", spoil, (), command, may_pass=True)


def changed_message(rng: Random, message: Any) -> bytes:
    """A changed message to a page."""
    if rng.random() < 0.25:
        return json.dumps(message).encode() if rng.random() < 0.4 else change_bytes(rng, json.dumps(message).encode())
    return json.dumps(change_tree(rng, message)).encode()


def _json_file(file: str) -> Callable[[Random], Change]:
    def make(rng: Random) -> Change:
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


def _ledger(rng: Random) -> Change:
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


def _attempts(rng: Random) -> Change:
    """A change of the attempts at trials, or of the versions that they were made with."""

    def change(folder: Path) -> None:
        connection = sqlite3.connect(folder / LEDGER)
        connection.execute("PRAGMA foreign_keys = OFF")
        kind = rng.random()
        (content,) = connection.execute("SELECT content FROM versions").fetchone()
        keys = [key for (key,) in connection.execute("SELECT key FROM attempts")]
        with connection, suppress(sqlite3.Error):  # some values no column takes
            if kind < 0.4:
                changed = json.dumps(change_tree(rng, json.loads(content)))
                if rng.random() < 0.3:
                    changed = change_bytes(rng, content.encode()).decode("utf-8", "replace")
                connection.execute("UPDATE versions SET content = ?", (changed,))
            elif kind < 0.8:
                name = rng.choice((*ATTEMPTS["attempts"], *ATTEMPTS["versions"]))
                table = "attempts" if name in ATTEMPTS["attempts"] else "versions"
                where = " WHERE key = ?" if table == "attempts" and rng.random() < 0.7 else ""
                given = (_sql_value(rng), *([rng.choice(keys)] if where else []))
                connection.execute(f"UPDATE {table} SET {name} = ?{where}", given)
            elif kind < 0.9:
                row = [_sql_value(rng) for _ in ATTEMPTS["attempts"]]
                row[0], row[1] = rng.choice((*keys, row[0])), rng.choice((2, 3, row[1]))
                connection.execute(f"INSERT INTO attempts VALUES ({', '.join('?' * len(row))})", row)
            else:
                connection.execute(f"DELETE FROM {rng.choice(('attempts', 'versions', 'records', 'planned'))}")
        connection.close()

    return LEDGER, change


def _sql_value(rng: Random) -> Any:
    """A random value that SQLite can hold."""
    numbers = [n for n in NUMBERS if isinstance(n, float) or abs(n) < 2**63]
    return rng.choice((*(t for t in TEXTS if t != "\ud800"), *numbers, None, b"x", b"\xff" * 1000))


def _recording(rng: Random) -> Change:
    def change(folder: Path) -> None:
        place = folder / "run" / "recordings"
        place.mkdir()
        for method, file in RECORDINGS.items():
            content = (folder / file).read_bytes()
            changed = change_bytes(rng, content) if method == "random" else content
            (place / f"N1M1-1-in-place-{method}-0-bench-truth.rrd").write_bytes(changed)

    return "recording", change


def _import(rng: Random) -> Change:
    file = rng.choice(("one.json", "two.json") * 4 + ("whole.stl", "half.obj", "half.ply", "half.glb"))

    def change(folder: Path) -> None:
        target = folder / RECORDED / file
        if target.suffix == ".json" and rng.random() < 0.8:
            change_one = change_tree if rng.random() < 0.5 else change_plausibly
            target.write_text(json.dumps(change_one(rng, json.loads(target.read_bytes()))))
        else:
            target.write_bytes(change_bytes(rng, target.read_bytes()))
        if file == "half.glb":
            (folder / RECORDED / "half.obj").unlink()
            text = (folder / RECORDED / "two.json").read_text()
            (folder / RECORDED / "two.json").write_text(text.replace("half.obj", "half.glb"))

    return f"{RECORDED}/{file}", change


def _toml(file: str) -> Callable[[Random], Change]:
    def make(rng: Random) -> Change:
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


def _urdf(rng: Random) -> Change:
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


def _mesh(rng: Random) -> Change:
    file = f"box.{rng.choice(('stl', 'obj', 'ply', 'glb'))}"

    def change(folder: Path) -> None:
        target = folder / file
        target.write_bytes(change_bytes(rng, target.read_bytes()))

    return file, change


def _ratings(rng: Random) -> Change:
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


def _journal(rng: Random) -> Change:
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
    "tables": change_table,
    "tensors": change_tensor,
    "ledger": _ledger,
    "settings": _toml("settings.toml"),
    "study": _toml("study.toml"),
    "urdf": _urdf,
    "mesh": _mesh,
    "attempts": _attempts,
    "recording": _recording,
    "import": _import,
    "ratings": _ratings,
    "journal": _journal,
    "trajectory": _json_file("trajectory.json"),
}


def counts(total: int, readers: Sequence[str] = ()) -> dict[str, int]:
    """How many of `total` inputs each reader gets."""
    shares = {reader: share for reader, share in SHARES.items() if not readers or reader in readers}
    return {reader: round(total * share / sum(shares.values())) for reader, share in shares.items()}
