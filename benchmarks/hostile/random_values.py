"""Random values and random changes of data and bytes, as the lists of hand-made hostile files suggest."""

import json
import math
import re
from random import Random
from typing import Any

from hostile.documents import ESCAPE

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
    for _ in range(rng.choice((5, 150, 190, 300, 400))):  # Python writes about 900 levels, and two may be nested
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


def change_plausibly(rng: Random, tree: Any) -> Any:
    """Change numbers a little or much, exchange values of one type, and drop or repeat entries of lists.

    Such data pass most checks of types and bounds, so that what computes with them is reached.
    """
    for _ in range(rng.choice((1, 1, 2, 4))):
        at, name = rng.choice(places(tree))
        old = at[name]
        if isinstance(old, float) and rng.random() < 0.8:
            at[name] = rng.choice((-old, old + rng.gauss(0.0, 0.01), old + rng.gauss(0.0, 1.0), 0.0, 1.0, 1e-9, 1e5))
        elif isinstance(old, list) and old and rng.random() < 0.5:
            del old[rng.randrange(len(old))]
        elif isinstance(old, list) and old and rng.random() < 0.5:
            old.insert(rng.randrange(len(old)), json.loads(json.dumps(rng.choice(old))))
        else:
            alike = [there[other] for there, other in places(tree) if type(there[other]) is type(old)]
            at[name] = json.loads(json.dumps(rng.choice(alike)))
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
