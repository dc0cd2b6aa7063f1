"""Every knob, one small class a room; `Settings` holds them all and reads a TOML file with one table a room."""

import dataclasses
import math
import tomllib
import typing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from cutgrammar.errors import InputError


@dataclass(frozen=True)
class DemonstratorSettings:
    """The scripted demonstrator's error.

    Attributes:
        offset_error: standard deviation of a plane's offset, as a share of the spacing to its neighbours.
        tilt_error_deg: standard deviation of a plane's tilt [degrees].
    """

    offset_error: float = 0.10
    tilt_error_deg: float = 2.0


@dataclass(frozen=True)
class FeatureSettings:
    """The point-cloud encoder and the shape feature z (III-D).

    Attributes:
        points: surface points per fragment.
        points_per_step: how many of them, drawn anew, the encoder sees in each step of training.
        shape_size: length of z_shape.
        hidden: width of the encoder's shared MLP and of the implicit decoder.
        epochs: passes over the training fragments.
        batch: fragments a step.
        queries: inside/outside points per fragment and step.
        learning_rate: greatest one of Adam; it rises and falls in one cycle.
    """

    points: int = 1024
    points_per_step: int = 64
    shape_size: int = 16
    hidden: int = 64
    epochs: int = 200
    batch: int = 8
    queries: int = 128
    learning_rate: float = 6e-3


@dataclass(frozen=True)
class InductionSettings:
    """MAP induction of the grammar (Eq. 1-2).

    Attributes:
        max_k: greatest number of fragment types tried.
        fixed_k: this many types instead of as many as Eq. (1) says; 0: as Eq. (1) says.
        restarts: random starts of the clustering for each k.
        spread: standard deviation of the features within a type, in units of their deviation among all fragments; the
            default is what the choice of the canonical frame's signs alone makes of the features of one fragment.
        gammas: the prior's coefficient per unit of model size, in units of half the log of the number of fragments for
            each number that a type brings, which is the Bayesian information criterion's; of several candidates
            held-out likelihood chooses.
        size: what |G| counts: "types" or "types+productions".
        emission: let the likelihood include the features given their types; without it the best k is 1.
        folds: training trials are held out in this many folds to choose gamma and for the curve.
        deals: how often the trials are dealt out into folds anew.
    """

    max_k: int = 64
    fixed_k: int = 0
    restarts: int = 4
    spread: float = 0.17
    gammas: tuple[float, ...] = (-1.0,)
    size: str = "types"
    emission: bool = True
    folds: int = 4
    deals: int = 1


@dataclass(frozen=True)
class ClassifierSettings:
    """The fragment-type classifier p(c|z).

    Attributes:
        hidden: width of its hidden layer.
        epochs: longest training; held-out trials choose how much of it is used.
        learning_rate, weight_decay: of AdamW.
        folds: training trials are held out in this many folds to stop in time and to calibrate.
    """

    hidden: int = 64
    epochs: int = 400
    learning_rate: float = 3e-3
    weight_decay: float = 1e-2
    folds: int = 4


@dataclass(frozen=True)
class PlaneSettings:
    """The mixture density network for cutting planes (III-C).

    Attributes:
        components: Gaussians in the mixture.
        hidden: width of the hidden layer.
        epochs: longest training; held-out trials choose how much of it is used.
        learning_rate, weight_decay: of AdamW.
        min_sigma: floor of their standard deviations, in normalised units.
        jitter: standard deviation of the noise on z in training, in units of its own deviation.
        folds: training trials are held out in this many folds to stop in time.
    """

    components: int = 16
    hidden: int = 64
    epochs: int = 400
    learning_rate: float = 2e-3
    weight_decay: float = 1e-2
    min_sigma: float = 0.02
    jitter: float = 1.5
    folds: int = 4


@dataclass(frozen=True)
class BaselineSettings:
    """The learned baselines `bc` and `qnet`, and the plane head they share (IV-B1).

    Attributes:
        embedding: length of the state embedding s.
        hidden: width of every hidden layer.
        epochs: longest training; held-out trials choose how much of it is used.
        learning_rate, weight_decay: of AdamW.
        jitter: standard deviation of the noise on z in training, in units of its own deviation.
        plane_epochs, plane_jitter: the same of the plane head; its mixture is that of `PlaneSettings`.
        folds: training trials are held out in this many folds to stop in time.
        discount: of the reward for reaching the goal, for each cut before it.
        margin: by how much the fragment that was cut should be worth more than any other.
        margin_weight: of the large-margin loss beside the temporal difference.
        target_epochs: epochs after which the values to learn from are brought up to date.
    """

    embedding: int = 32
    hidden: int = 64
    epochs: int = 400
    learning_rate: float = 2e-3
    weight_decay: float = 1e-2
    jitter: float = 0.5
    plane_epochs: int = 400
    plane_jitter: float = 2.0
    folds: int = 4
    discount: float = 0.9
    margin: float = 0.2
    margin_weight: float = 1.0
    target_epochs: int = 10


@dataclass(frozen=True)
class CuttingSettings:
    """From a mixture over cutting planes to one plane (III-C); the same for every method that has a mixture.

    Attributes:
        draws: planes drawn from the mixture, of which the one with most others near it is cut; every
            refusal in a step halves them.
    """

    draws: int = 64


@dataclass(frozen=True)
class SearchSettings:
    """Inference of the best parse tree (III-A, III-B).

    Attributes:
        keys: independent searches, whose best result wins; any number of planner actors shares them.
        rounds: most rollouts of each search.
        starts: draws of the current fragments' types for each search, the expansions of v_S.
        min_type_probability: a type less probable for a current fragment counts as impossible.
        exploration: weight of the exploration term of UCT.
        swaps: annealing swaps per terminal and rollout.
        reach: distance at which a fragment becomes e times less likely in Eq. (7), relative to the cube root of the
            current fragments' total volume, which cutting does not change.
        divide_by_type_prior: read Eq. (5) as p(c|z)/p(c); False: as printed.
    """

    keys: int = 4
    rounds: int = 50
    starts: int = 8
    min_type_probability: float = 1e-6
    exploration: float = 0.2
    swaps: int = 20
    reach: float = 1.0
    divide_by_type_prior: bool = True


@dataclass(frozen=True)
class WorldSettings:
    """What holds for cutting in every world, and the SAPIEN board.

    Attributes:
        min_share: a cut with a product under this share of the fragment's volume is refused.
        blade_thickness_mm: how far the halves part.
        density: of every food [kg/m3].
        settle_seconds: longest simulated time for the fragments to come to rest after a cut.
    """

    min_share: float = 1e-3
    blade_thickness_mm: float = 1.0
    density: float = 1000.0
    settle_seconds: float = 2.0


@dataclass(frozen=True)
class KinovaSettings:
    """The arm that makes the cuts, and its tool.

    Attributes:
        urdf: another arm than the Kinova Gen3: the text of its URDF; empty for the Gen3.
        flange: name of the link of that URDF which the tool is fixed to; its z points out of the flange.
        blade_length_mm, blade_height_mm: of the knife.
        press_speed: of the blade's edge while it cuts [m/s].
        speed_share: share of the joints' velocity limits that motions are planned with.
        acceleration: greatest of any joint [rad/s2].
        max_tilt_deg: greatest angle between a cutting plane and the vertical that is pressed without turning the
            fragment first [degrees].
        toughness: fracture toughness of a food that is not in the world's table, such as one's own mesh [J/m2].
    """

    urdf: str = ""
    flange: str = ""
    blade_length_mm: float = 240.0
    blade_height_mm: float = 80.0
    press_speed: float = 0.1
    speed_share: float = 0.8
    acceleration: float = 5.0
    max_tilt_deg: float = 35.0
    toughness: float = 724.0


@dataclass(frozen=True)
class CameraSettings:
    """The two depth cameras.

    Attributes:
        renderer: "auto" renders with Vulkan where a device exists and casts rays elsewhere; or "vulkan", "rays".
        width, height: of an image [pixels].
        depth_noise: standard deviation of the depth at 1 m, growing with its square, as of a stereo sensor [m].
        points: of the fused cloud that are kept.
    """

    renderer: str = "auto"
    width: int = 640
    height: int = 480
    depth_noise: float = 1e-3
    points: int = 8192


@dataclass(frozen=True)
class VisionSettings:
    """The segmentation of the fused cloud into fragments, and its training on simulated scenes.

    Attributes:
        scenes: simulated for training.
        epochs: passes over them.
        learning_rate: greatest one of AdamW.
        hidden: width of every hidden layer.
        message_rounds: rounds in which points tell their neighbours what they know.
        threshold: mean probability along a seam from which on two clusters are one, where no scene is held out that
            could choose it.
        belief: let the robot go on knowing, when it looks again, what it saw before and the plane it has cut with, for
            no camera shows the seam of a cut; False: every cloud is segmented by itself.
    """

    scenes: int = 300
    epochs: int = 8
    learning_rate: float = 4e-3
    hidden: int = 24
    message_rounds: int = 2
    threshold: float = 0.5
    belief: bool = True


@dataclass(frozen=True)
class TrialSettings:
    """How a trial ends."""

    max_refusals: int = 10


@dataclass(frozen=True)
class Settings:
    """All knobs; each room reads its own."""

    demonstrator: DemonstratorSettings = field(default_factory=DemonstratorSettings)
    features: FeatureSettings = field(default_factory=FeatureSettings)
    induction: InductionSettings = field(default_factory=InductionSettings)
    classifier: ClassifierSettings = field(default_factory=ClassifierSettings)
    planes: PlaneSettings = field(default_factory=PlaneSettings)
    baselines: BaselineSettings = field(default_factory=BaselineSettings)
    search: SearchSettings = field(default_factory=SearchSettings)
    cutting: CuttingSettings = field(default_factory=CuttingSettings)
    world: WorldSettings = field(default_factory=WorldSettings)
    kinova: KinovaSettings = field(default_factory=KinovaSettings)
    cameras: CameraSettings = field(default_factory=CameraSettings)
    vision: VisionSettings = field(default_factory=VisionSettings)
    trial: TrialSettings = field(default_factory=TrialSettings)


T = TypeVar("T")
LEAST = {
    "gammas": -math.inf,
    "swaps": 0,
    "folds": 0,
    "seed": 0,
    "seed_offset": 0,
    "fixed_k": 0,
    "train_trials": 0,
    "test_trials": 0,
    "reach": 1e-9,
    "density": 1e-9,
    "points": 32,
    "threshold": 0.01,
}
"""Least value of a knob by its name; of the others 1 for a whole number and 0 for any other."""
MOST = {
    "gammas": 0.0,
    "min_share": 0.5,
    "offset_error": 1.0,
    "tilt_error_deg": 45.0,
    "discount": 1.0,
    "max_k": 1000,
    "threshold": 0.99,
}
"""Greatest value of a knob by its name, where there is one."""
CHOICES = {"size": ("types", "types+productions"), "renderer": ("auto", "vulkan", "rays")}
"""The words that a knob can be, by its name."""


def load_settings(path: Path | None) -> Settings:
    """The defaults, changed by the TOML file at `path` (one table a room, e.g. `[search]`).

    Raises:
        InputError: no such file, not TOML, an unknown table or name, or a value of another type or too small.
    """
    return Settings() if path is None else from_tables(read_tables(path), str(path))


def read_tables(path: Path) -> dict[str, Any]:
    """The TOML file at `path` as nested dictionaries.

    Raises:
        InputError: no such file, or not TOML.
    """
    try:
        return tomllib.loads(path.read_text())
    except FileNotFoundError:
        raise InputError(f"settings file {path} does not exist") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"settings file {path} cannot be read: {error}") from None


def from_tables(tables: Any, source: str) -> Settings:
    """Settings from nested dictionaries, as in a TOML file or a model's JSON; `source` names them in errors.

    Raises:
        InputError: an unknown table or name, or a value of another type or too small.
    """
    return build(Settings, tables, source, "")


def build(cls: type[T], table: Any, source: str, prefix: str = "") -> T:
    """A settings class from a dictionary; `source` and `prefix` name the place in errors.

    Raises:
        InputError: an unknown name, or a value of another type or too small.
    """
    if not isinstance(table, dict):
        raise InputError(f"{source}: {prefix or 'the top level'} must be a table, not {table!r}")
    hints = typing.get_type_hints(cls)
    unknown = [name for name in table if name not in hints]
    if unknown:
        raise InputError(f"{source}: unknown setting {prefix}{unknown[0]!r}; known: {', '.join(hints)}")
    return cls(**{name: _value(hints[name], value, source, f"{prefix}{name}") for name, value in table.items()})


def _value(hint: Any, value: Any, source: str, name: str) -> Any:
    if dataclasses.is_dataclass(hint):
        return build(typing.cast(type, hint), value, source, f"{name}.")
    if typing.get_origin(hint) is tuple and isinstance(value, list | tuple):
        inner = typing.get_args(hint)[0]
        if not value:
            raise InputError(f"{source}: {name} is empty; at least one value is needed")
        return tuple(_value(inner, item, source, name) for item in value)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if not (isinstance(hint, type) and isinstance(value, hint) and (hint is bool or not isinstance(value, bool))):
        raise InputError(f"{source}: {name} = {value!r} is not of type {getattr(hint, '__name__', str(hint))}")
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{source}: {name} = {value!r} is not a finite number")
    knob = name.rpartition(".")[2]
    if isinstance(value, int | float) and not isinstance(value, bool):
        least, most = LEAST.get(knob, 1 if isinstance(value, int) else 0), MOST.get(knob, math.inf)
        if value < least:
            raise InputError(f"{source}: {name} = {value!r} is too small; {least:g} is the least")
        if value > most:
            raise InputError(f"{source}: {name} = {value!r} is too large; {most:g} is the greatest")
    if knob in CHOICES and value not in CHOICES[knob]:
        raise InputError(f"{source}: {name} = {value!r} is unknown; known: {', '.join(CHOICES[knob])}")
    return value
