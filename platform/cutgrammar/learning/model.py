"""The model: everything learned from the training trials, and the folder that holds it.

- `encoder.safetensors`, `classifier.safetensors`, `planes.safetensors`: the networks of the paper's method;
- `bc.safetensors`, `qnet.safetensors`, `goal_planes.safetensors`: those of the baselines;
- `segmentation.safetensors`: the network that separates fragments in a cloud, where it was trained;
- `grammar.json`: the grammar, also readable by people;
- `model.json`: schema version, settings, provenance, metrics, and the sha256 of every other file.

The digest of a model is the sha256 of `model.json`, hence of everything. Equal models give equal bytes, and nothing in
the folder is a pickle.
"""

import dataclasses
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from cutgrammar.atomic_files import atomic_folder, json_bytes
from cutgrammar.cutting.goal_planes import GoalPlaneNetwork
from cutgrammar.cutting.planes import PlaneNetwork
from cutgrammar.errors import InputError
from cutgrammar.grammar.production import Grammar
from cutgrammar.learning.model_schema import GRAMMAR_FILE, MODEL, check_types
from cutgrammar.nn.set_network import SetNetwork
from cutgrammar.perception.classifier import TypeClassifier
from cutgrammar.perception.feature import FeatureExtractor
from cutgrammar.perception.vision.segmentation import Segmentation
from cutgrammar.settings import Settings, from_tables
from cutgrammar.untrusted import check, parse_json, read_regular, shortened

SCHEMA = 4
"""Version of the folder's format; other versions are refused."""

ENCODER, CLASSIFIER, PLANES, GRAMMAR = (
    "encoder.safetensors",
    "classifier.safetensors",
    "planes.safetensors",
    "grammar.json",
)
POLICY, VALUES, GOAL_PLANES = "bc.safetensors", "qnet.safetensors", "goal_planes.safetensors"
SEGMENTATION = "segmentation.safetensors"
MAX_BYTES = 200_000_000
"""Most bytes of one file of a model; a paper model has 0.5 MB in all."""
T = TypeVar("T")


@dataclass(frozen=True)
class Provenance:
    """Where a model came from.

    Attributes:
        data: digest of the data set.
        split: name of the split whose training trials were used.
        split_digest: sha256 of which trials train and which test.
        trials: the numbers of the training trials.
        seed: of the training.
        package: version of cutgrammar that trained it.
    """

    data: str
    split: str
    split_digest: str
    trials: tuple[int, ...]
    seed: int
    package: str = dataclasses.field(default_factory=lambda: version("cutgrammar"))


@dataclass(frozen=True, eq=False)
class Model:
    """A trained model.

    Attributes:
        settings: settings of the training.
        features: fragment -> shape feature z (III-D).
        classifier: p(c|z) (II-B).
        grammar: the induced grammar (Eq. 1-2).
        planes: the mixture density network for cutting planes (III-C).
        policy: of `bc` (IV-B1): one score for a fragment, given the current configuration and the goal.
        values: the Q function of `qnet` (IV-B1), likewise.
        goal_planes: the plane head that `bc` and `qnet` share (IV-B1).
        provenance: where it came from.
        segmentation: fused cloud -> fragments (IV-D); None where it was not trained.
        induction: how the grammar was chosen, e.g. the curve over k; plain data.
        metrics: what was measured in training, by name.
        as_read: `model.json` as it is on disk; None for a model that was not read from there, or was replaced since.
    """

    settings: Settings
    features: FeatureExtractor
    classifier: TypeClassifier
    grammar: Grammar
    planes: PlaneNetwork
    policy: SetNetwork
    values: SetNetwork
    goal_planes: GoalPlaneNetwork
    provenance: Provenance
    segmentation: Segmentation | None = None
    induction: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    metrics: Mapping[str, float] = dataclasses.field(default_factory=dict)
    as_read: bytes | None = dataclasses.field(default=None, init=False)

    def __post_init__(self) -> None:
        k, size = self.grammar.k, self.features.size
        if self.classifier.k != k or self.planes.k != k:
            raise ValueError(f"grammar, classifier and planes have {k}, {self.classifier.k} and {self.planes.k} types")
        if self.classifier.layers.sizes[0] != size or self.planes.layers.sizes[0] != 2 * k + size:
            raise ValueError(f"classifier or planes do not take features of length {size}")
        if any(network.projection.sizes[0] != size for network in (self.policy, self.values, self.goal_planes.network)):
            raise ValueError(f"the networks of the baselines do not take features of length {size}")
        if any((network.sets, network.head.sizes[-1]) != (2, 1) for network in (self.policy, self.values)):
            raise ValueError("the networks of bc and qnet give one score from a fragment and two sets of fragments")

    @cached_property
    def files(self) -> dict[str, bytes]:
        """Content of the folder's files, by name.

        A model that was read keeps its `model.json`, and so its digest, where later releases added settings.
        """
        parts = {
            ENCODER: self.features.to_bytes(),
            CLASSIFIER: self.classifier.to_bytes(),
            PLANES: self.planes.to_bytes(),
            POLICY: self.policy.to_bytes(),
            VALUES: self.values.to_bytes(),
            GOAL_PLANES: self.goal_planes.to_bytes(),
            GRAMMAR: json_bytes({**_readable(self.grammar), "induction": self.induction}),
        }
        if self.segmentation is not None:
            parts[SEGMENTATION] = self.segmentation.to_bytes()
        if self.as_read is not None:
            return {**parts, "model.json": self.as_read}
        facts = {
            "schema": SCHEMA,
            "settings": dataclasses.asdict(self.settings),
            "provenance": dataclasses.asdict(self.provenance),
            "metrics": dict(self.metrics),
            "files": {name: hashlib.sha256(content).hexdigest() for name, content in parts.items()},
        }
        return {**parts, "model.json": json_bytes(facts)}

    @property
    def digest(self) -> str:
        """sha256 of `model.json`, which holds the digests of all other files."""
        return hashlib.sha256(self.files["model.json"]).hexdigest()


def save_model(model: Model, out: Path) -> None:
    """Write the model to folder `out`, completely or not at all.

    Raises:
        InputError: `out` exists and is not an empty folder.
    """
    with atomic_folder(out) as folder:
        for name, content in model.files.items():
            (folder / name).write_bytes(content)


def load_model(path: Path) -> Model:
    """Read the model in folder `path`.

    Raises:
        InputError: there is no model, it has another schema version, or a file is missing or damaged.
    """
    as_read, facts = _facts(path)
    content = {name: _checked(path, name, digest) for name, digest in facts["files"].items()}

    def part(name: str, read: Callable[[bytes], T]) -> T:
        return _parsed(path, name, lambda: read(content[name]))

    settings, features = (
        from_tables(facts["settings"], str(path / "model.json")),
        part(ENCODER, FeatureExtractor.from_bytes),
    )
    grammar = part(GRAMMAR, lambda data: _checked_grammar(data, features.size))
    model = _parsed(
        path,
        "model.json",
        lambda: Model(
            settings=settings,
            features=features,
            classifier=part(CLASSIFIER, TypeClassifier.from_bytes),
            grammar=_parsed(path, GRAMMAR, lambda: Grammar.from_json(grammar)),
            planes=part(PLANES, PlaneNetwork.from_bytes),
            policy=part(POLICY, _scores),
            values=part(VALUES, _scores),
            goal_planes=part(GOAL_PLANES, GoalPlaneNetwork.from_bytes),
            segmentation=part(SEGMENTATION, Segmentation.from_bytes) if SEGMENTATION in content else None,
            provenance=Provenance(**{**facts["provenance"], "trials": tuple(facts["provenance"]["trials"])}),
            induction=grammar["induction"],
            metrics=facts["metrics"],
        ),
    )
    object.__setattr__(model, "as_read", as_read)
    return model


def _facts(path: Path) -> tuple[bytes, dict[str, Any]]:
    """`model.json` as it is, and what it says."""
    file = path / "model.json"
    if not path.exists():
        raise InputError(f"model {path} does not exist; train one with cutgrammar train --out {path}")
    try:
        content = read_regular(file, MAX_BYTES)
        facts: dict[str, Any] = parse_json(content)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{path} is not a model: it has no model.json; cutgrammar train makes one") from None
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(f"{file} is damaged or is not a model's ({error}); train again") from None
    found = facts.get("schema") if isinstance(facts, dict) else None
    if type(found) is int and found != SCHEMA:
        raise InputError(f"{file} has schema {shortened(found)}; this version reads schema {SCHEMA}: train again")
    try:
        check(MODEL, facts)
    except ValueError as error:
        raise InputError(f"{file} is not a model's: {error}; cutgrammar train makes one") from None
    if set(facts["files"]) - {SEGMENTATION} != {ENCODER, CLASSIFIER, PLANES, GRAMMAR, POLICY, VALUES, GOAL_PLANES}:
        raise InputError(f"{file} names other files than a model has; train again")
    return content, facts


def _checked(path: Path, name: str, digest: str) -> bytes:
    try:
        content = read_regular(path / name, MAX_BYTES)
    except OSError as error:
        raise InputError(f"model {path} lacks {name} ({error.strerror}); put it back, or train again") from None
    if hashlib.sha256(content).hexdigest() != digest:
        raise InputError(
            f"model {path}: {name} is damaged: its sha256 is not the one in model.json;"
            " restore the file, or train again"
        )
    return content


def _parsed(path: Path, name: str, read: Callable[[], T]) -> T:
    try:
        return read()
    except InputError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"model {path}: {name} is not a model's ({error}); train again") from None


def _checked_grammar(data: bytes, features: int) -> dict[str, Any]:
    grammar: dict[str, Any] = parse_json(data)
    check(GRAMMAR_FILE, grammar)
    check_types(grammar, features)
    return grammar


def _scores(data: bytes) -> SetNetwork:
    network, others = SetNetwork.from_bytes(data)
    if others:
        raise ValueError("not a network that scores fragments")
    return network


def _readable(grammar: Grammar) -> dict[str, Any]:
    """The grammar as plain data, each production with its text."""
    data = grammar.to_json()
    productions = sorted(grammar.probabilities)
    rows = [{**row, "text": str(production)} for row, production in zip(data["productions"], productions, strict=True)]
    return {**data, "productions": rows}
