"""Trained multi-layer perceptrons, evaluated in double precision without torch.

Sums run in one fixed order, whatever the size of the batch, the number of threads or the BLAS library, so that a row's
result always has the same bits. Hidden layers are rectified, the last one is linear.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors
from safetensors.numpy import save as save_tensors

from cutgrammar.geometry.arrays import Floats, frozen_floats

MAX_UNITS = 100_000
"""Largest size of a layer in a file."""
MAX_NUMBER = 1e12
"""Largest magnitude of a number in a file, so that no sum of products is infinite."""


@dataclass(frozen=True, eq=False)
class MLP:
    """A trained multi-layer perceptron.

    Attributes:
        weights: (in, out) of each layer.
        biases: (out,) of each layer.
    """

    weights: tuple[Floats, ...]
    biases: tuple[Floats, ...]

    def __post_init__(self) -> None:
        weights = tuple(frozen_floats(w, (None, None), "weights") for w in self.weights)
        biases = tuple(frozen_floats(b, (None,), "biases") for b in self.biases)
        if not weights or [len(b) for b in biases] != [w.shape[1] for w in weights]:
            raise ValueError("the biases of a network do not fit its weights")
        if [w.shape[1] for w in weights[:-1]] != [w.shape[0] for w in weights[1:]]:
            raise ValueError("the layers of a network do not fit one another")
        object.__setattr__(self, "weights", weights)
        object.__setattr__(self, "biases", biases)

    def __reduce__(self) -> tuple[Any, ...]:
        return MLP, (self.weights, self.biases)

    def __call__(self, x: Floats) -> Floats:
        """Outputs (n, out) for inputs (n, in)."""
        last = len(self.weights) - 1
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = _linear(np.ascontiguousarray(x), weight, bias, i < last)
        return x

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of inputs, of units in each hidden layer, and of outputs."""
        return (self.weights[0].shape[0], *(w.shape[1] for w in self.weights))


@numba.njit(cache=True)  # type: ignore[misc, unused-ignore]
def _linear(x: Floats, weight: Floats, bias: Floats, rectified: bool) -> Floats:
    """Outputs (n, out) of one layer for inputs (n, in); the sum runs over the inputs in their order."""
    result = np.empty((x.shape[0], weight.shape[1]))
    for i in range(x.shape[0]):
        for j in range(weight.shape[1]):
            result[i, j] = bias[j]
        for k in range(x.shape[1]):
            value = x[i, k]
            if value != 0.0:  # rectified inputs are often zero
                for j in range(weight.shape[1]):
                    result[i, j] += value * weight[k, j]
        if rectified:
            for j in range(weight.shape[1]):
                result[i, j] = max(result[i, j], 0.0)
    return result


def with_standardised_inputs(layers: MLP, mean: Floats, deviation: Floats) -> MLP:
    """The network for plain inputs (in,) that does what `layers` does for standardised ones."""
    first = layers.weights[0] / deviation[:, None]
    return MLP((first, *layers.weights[1:]), (layers.biases[0] - mean @ first, *layers.biases[1:]))


def deviation_of(x: Floats) -> Floats:
    """(in,) standard deviations of inputs (n, in); 1 for a constant input."""
    deviation = x.std(axis=0)
    return np.where(deviation > 1e-9, deviation, 1.0)


def common_deviation_of(x: Floats) -> Floats:
    """(in,) root mean square of the standard deviations of inputs (n, in), for every input; 1 for constant inputs.

    It keeps the ratios of distances between rows.
    """
    deviation = float(np.sqrt(x.var(axis=0).mean()))
    return np.full(x.shape[1], deviation if deviation > 1e-9 else 1.0)


# --- on disk ----------------------------------------------------------------------------------------------------------


def to_bytes(layers: MLP, **others: Floats) -> bytes:
    """The network and other arrays in the safetensors format; the same values give the same bytes."""
    arrays = others | named_arrays(layers, "layer")
    return bytes(save_tensors({name: np.ascontiguousarray(arrays[name]) for name in sorted(arrays)}))


def from_bytes(data: bytes) -> tuple[MLP, Mapping[str, Floats]]:
    """The inverse of `to_bytes`.

    Raises:
        ValueError: the data are not those of a network.
    """
    try:
        arrays = load_tensors(data)
    except (SafetensorError, struct.error, KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"not a safetensors file: {error}") from None
    for name, array in arrays.items():
        if array.dtype not in (np.float64, np.float32) or array.ndim not in (1, 2):
            raise ValueError(
                f"{name!r} is an array {array.shape} of {array.dtype}; floating-point numbers are expected"
            )
        if not array.size or max(array.shape) > MAX_UNITS:
            raise ValueError(f"{name!r} has the shape {array.shape}; 1 to {MAX_UNITS} units are expected")
        if not (np.abs(array) <= MAX_NUMBER).all():
            raise ValueError(f"{name!r} holds numbers that are not finite, or beyond {MAX_NUMBER:g}")
    others = {name: arrays[name] for name in sorted(arrays) if not name.startswith("layer")}
    return from_named_arrays(arrays, "layer"), others


def number_in(arrays: Mapping[str, Floats], name: str, low: float, high: float, place: int = 0) -> float:
    """One number of an array that describes a network.

    Args:
        arrays: of the file.
        name: of the array.
        low, high: bounds of the number, inclusive.
        place: of the number in the array.

    Raises:
        ValueError: there is no such number, or it is out of bounds.
    """
    array = arrays[name]
    if array.ndim != 1 or place >= len(array) or not low <= array[place] <= high:
        found = array[place] if array.ndim == 1 and place < len(array) else "missing"
        raise ValueError(f"{name}[{place}] is {found}; {low:g} to {high:g} is expected")
    return float(array[place])


def whole_in(arrays: Mapping[str, Floats], name: str, low: int, high: int, place: int = 0) -> int:
    """The same for a whole number."""
    number = number_in(arrays, name, low, high, place)
    if number != int(number):
        raise ValueError(f"{name}[{place}] is {number:g}; a whole number is expected")
    return int(number)


def named_arrays(layers: MLP, prefix: str) -> dict[str, Floats]:
    """The weights and biases of a network, named "PREFIX0.weight", "PREFIX0.bias" and so on."""
    kinds = (("weight", layers.weights), ("bias", layers.biases))
    return {f"{prefix}{i}.{kind}": array for kind, arrays in kinds for i, array in enumerate(arrays)}


def from_named_arrays(arrays: Mapping[str, Floats], prefix: str) -> MLP:
    """The inverse of `named_arrays`; `arrays` may hold others.

    Raises:
        ValueError: an array is missing, or the arrays are not those of a network.
    """
    count = sum(name.startswith(prefix) and name.endswith(".weight") for name in arrays)
    try:
        weights, biases = ([arrays[f"{prefix}{i}.{k}"] for i in range(max(count, 1))] for k in ("weight", "bias"))
    except KeyError as error:
        raise ValueError(f"the network lacks {error.args[0]}") from None
    return MLP(tuple(weights), tuple(biases))
