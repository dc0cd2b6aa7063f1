"""Runs as they are logged to MLflow, as plain values.

A study is one experiment. Its top-level runs are of three kinds, which the tag `kind` names: one "method" for each
method, which carries metrics such as `iou_strict/N1M1`, so that MLflow's chart page is Table I; one "training" for each
model; one "report" for each evaluation. Single seeds or models of a method are its children, of kind "run". There is no
run for each trial, because the comparison page is slow with more than a hundred.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import json_bytes

KIND = "kind"
"""Tag that tells runs apart."""
METHOD, RUN, TRAINING, REPORT = "method", "run", "training", "report"
"""Values of the tag."""


@dataclass(frozen=True)
class Study:
    """What shares one experiment.

    Attributes:
        name: of the experiment, unless another study has it.
        digest: tells studies of one name apart: sha256 of the data set.
    """

    name: str
    digest: str

    @staticmethod
    def around(folder: Path, digest: str) -> "Study":
        """The study that a run or model belongs to: that of the folder which holds `folder`."""
        return Study(folder.resolve().parent.name or "cutgrammar", digest)


@dataclass(frozen=True)
class Input:
    """A data set that something was made from.

    Attributes:
        name: to show.
        digest: sha256 of it.
        path: its folder.
        context: what it was used for, e.g. "training".
    """

    name: str
    digest: str
    path: str
    context: str


@dataclass(frozen=True)
class RunLog:
    """One run of an experiment.

    Attributes:
        name: to show.
        identity: values that distinguish it from all other runs; logging the same identity again updates the run.
        params: settings, by name.
        metrics: single numbers, by name.
        curves: name -> (step, value) pairs.
        history: name -> (time [ms since 1970], value) pairs.
        tags: digests and names, to filter by.
        inputs: the data sets it was made from.
        texts: file name -> content.
        drawn: makes further files that follow from the texts, such as figures; called only if the run is logged.
        files: to be copied.
        model: folder of a trained model, to be copied and registered under the name of the study.
        description: in Markdown, shown on the run's page.
        children: runs within this one.
    """

    name: str
    identity: Mapping[str, Any]
    params: Mapping[str, Any] = field(default_factory=dict)
    metrics: Mapping[str, float] = field(default_factory=dict)
    curves: Mapping[str, Sequence[tuple[int, float]]] = field(default_factory=dict)
    history: Mapping[str, Sequence[tuple[int, float]]] = field(default_factory=dict)
    tags: Mapping[str, str] = field(default_factory=dict)
    inputs: tuple[Input, ...] = ()
    texts: Mapping[str, str] = field(default_factory=dict)
    drawn: Callable[[], Mapping[str, str]] | None = None
    files: tuple[Path, ...] = ()
    model: Path | None = None
    description: str = ""
    children: tuple["RunLog", ...] = ()

    @property
    def key(self) -> str:
        """Digest of the identity."""
        return hashlib.sha256(json_bytes(self.identity)).hexdigest()

    @property
    def content(self) -> str:
        """Digest of everything that is logged."""
        values = asdict(replace(self, drawn=None, files=(), model=None, history={}, children=())) | {
            "files": [[file.name, hashlib.sha256(file.read_bytes()).hexdigest()] for file in self.files],
            "children": [child.content for child in self.children],
        }
        return hashlib.sha256(json_bytes(values)).hexdigest()


def flat(tables: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested tables as one, e.g. {"search": {"rounds": 50}} as {"search.rounds": 50}."""
    result: dict[str, Any] = {}
    for name, value in tables.items():
        result |= flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return result
