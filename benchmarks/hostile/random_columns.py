"""Random changes of tables and tensors, which are signed anew."""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pyarrow as pa

from cutgrammar.storage.part_footers import trust_footer
from cutgrammar.storage.tables import SCHEMAS
from hostile.cases import sign
from hostile.good import sign_model
from hostile.random_values import NUMBERS, TEXTS, change_bytes, change_tree
from hostile.table_cases import change_rows
from hostile.tensor_cases import change_arrays

Change = tuple[str, Callable[[Path], None]]
"""The file that is changed, and what changes it in the folder of good files."""


def change_table(rng: Random) -> Change:
    """A change of a Parquet file of the data set."""
    table = rng.choice(list(SCHEMAS))
    file = f"data/{table}/part-00000.parquet"

    def change(folder: Path) -> None:
        if rng.random() < 0.25:
            target = folder / file
            target.write_bytes(change_bytes(rng, target.read_bytes()))
            sign(folder, file)
            return
        change_rows(folder, table, lambda rows: _changed_rows(rng, table, rows), trial=rng.randrange(6))
        trust_footer(folder / file)  # pyarrow wrote it

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


def change_tensor(rng: Random) -> Change:
    """A change of a network's file."""
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
