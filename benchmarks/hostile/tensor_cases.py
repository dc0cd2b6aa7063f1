"""Hostile networks of a model, with digests made anew."""

import json
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load, save

from hostile.cases import Case, bytes_case
from hostile.documents import _fifo, _link
from hostile.good import sign_model

Arrays = dict[str, Any]


def change_arrays(folder: Path, name: str, change: Callable[[Arrays], Any]) -> None:
    """Change the arrays of a network; the digests are made anew."""
    file = folder / "model" / f"{name}.safetensors"
    arrays = load(file.read_bytes())
    changed = change(arrays)
    file.write_bytes(save(arrays if changed is None else changed))
    sign_model(folder / "model")


def tensor_cases() -> Iterator[Case]:
    """All cases."""

    def case(network: str, name: str, change: Callable[[Arrays], Any], **options: Any) -> Case:
        return Case(
            "model",
            f"{network}: {name}",
            lambda folder: change_arrays(folder, network, change),
            [f"{network}.safetensors"],
            **options,
        )

    for network in ("encoder", "classifier", "planes", "bc", "qnet", "goal_planes"):
        file = f"model/{network}.safetensors"
        for name, content in (
            ("empty", b""),
            ("zeros", bytes(100)),
            ("cut short", lambda old: old[:-9]),
            ("a header of 10^15 bytes", lambda old: struct.pack("<Q", 10**15) + old[8:]),
            ("a deep header", lambda _: _header(b"[" * 5000 + b"]" * 5000)),
            (
                "a shape of 10^15",
                lambda _: _header(
                    json.dumps(
                        {"layer0.weight": {"dtype": "F64", "shape": [10**8, 10**7], "data_offsets": [0, 0]}}
                    ).encode()
                ),
            ),
            ("a pickle", b"\x80\x04cos\nsystem\n(S'touch /tmp/owned'\ntR."),
        ):
            yield bytes_case("model", file, name, content)
        yield Case(
            "model", f"{network}: a FIFO", lambda folder, file=file: _fifo(folder / file), [f"{network}.safetensors"]
        )
        yield Case(
            "model",
            f"{network}: endless",
            lambda folder, file=file: _link(folder / file, "/dev/zero"),
            [f"{network}.safetensors"],
        )
        yield case(network, "NaN", lambda a: a["layer0.weight"].__setitem__((0, 0), np.nan))
        yield case(network, "infinity", lambda a: a["layer0.bias"].__setitem__(0, np.inf))
        yield case(network, "1e300", lambda a: a["layer0.weight"].__setitem__((0, 0), 1e300))
        yield case(network, "integers", lambda a: {k: v.astype(np.int64) for k, v in a.items()})
        yield case(network, "a missing layer", lambda a: a.pop("layer0.bias") is None or a)
        yield case(network, "a further array", lambda a: a.update(other=np.zeros(3)))
        yield case(
            network,
            "a layer without units",
            lambda a: a.update(
                {"layer0.weight": np.zeros((a["layer0.weight"].shape[0], 0)), "layer0.bias": np.zeros(0)}
            ),
        )
        yield case(network, "another shape", lambda a: a.update({"layer0.weight": np.zeros((2, 2, 2))}))
    for network, array, values in (
        ("classifier", "k", ([], [-1.0], [1e9], [2.5], [np.nan], [1e300], [[3.0]])),
        (
            "classifier",
            "seen",
            ([0.0, 0.0, 1.0], [0.0, 1.0, 99.0], [-1.0, 0.0, 1.0], [0.5, 1.0, 2.0], [np.nan] * 3, [2.0, 1.0, 0.0]),
        ),
        ("classifier", "temperature", ([], [0.0], [-1.0], [np.nan], [np.inf])),
        ("encoder", "points", ([], [0.0], [1e12], [np.nan], [-5.0], [64.5])),
        (
            "planes",
            "numbers",
            (
                [],
                [3.0, 1e9, 0.02],
                [np.nan, 16.0, 0.02],
                [3.0, 16.0, -1.0],
                [3.0, 0.0, 0.02],
                [3.0, 16.0, np.inf],
                [-3.0, 16.0, 0.02],
            ),
        ),
        (
            "goal_planes",
            "numbers",
            ([], [1e9, 0.02], [np.nan, 0.02], [16.0, -1.0], [16.0, np.inf], [0.0, 0.02], [15.0, 0.02]),
        ),
    ):
        for value in values:
            yield case(
                network, f"{array} = {value}", lambda a, array=array, value=value: a.update({array: np.array(value)})
            )


def _header(text: bytes) -> bytes:
    return struct.pack("<Q", len(text)) + text
