"""Train: everything is learned from the training trials of a split, and becomes a model folder.

MLflow is told by whoever calls, with what comes back (`tracking.log_training`).
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cutgrammar.atomic_files import check_place
from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.grammar.text import describe
from cutgrammar.learning.learn import Learned, Watch, learn, settings_used
from cutgrammar.learning.model import Model, Provenance, load_model, save_model
from cutgrammar.perception.vision.fused_cloud import LabelledCloud
from cutgrammar.settings import Settings
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.differences import first_difference
from cutgrammar.storage.split import read_split
from cutgrammar_pipelines.stages.progress import Advance, progress


@dataclass(frozen=True, eq=False)
class Trained:
    """What `train` leaves.

    Attributes:
        path: the model's folder.
        model: the model in it.
        learned: how its parts came about; None if the folder held this model already.
    """

    path: Path
    model: Model
    learned: Learned | None


def train(
    data: Path,
    out: Path,
    seed: int = 0,
    settings: Settings | None = None,
    split: str = "paper",
    allow_missing: bool = False,
    vision: bool = False,
) -> Trained:
    """Learn a model from the training trials of a data set's split; the same arguments give the same bytes.

    Args:
        data: a data set with a split.
        out: the folder to make. If it holds the model of the very same training already, nothing is done.
        seed: of the training.
        settings: those of features, induction, classifier, planes and baselines are used; with `vision` also those of
            the segmentation, the cameras and the world.
        split: name of the split.
        allow_missing: go on without parts of the data set that are missing or torn.
        vision: also learn to tell fragments in the cameras' clouds apart, from simulated scenes of the training foods.

    Raises:
        InputError: no such data set or split, no training trial or no cut in them, or `out` is in use.

    Example:
        >>> trained = train(Path("data"), Path("model"))  # doctest: +SKIP
        >>> print(describe(trained.model.grammar))  # doctest: +SKIP
    """
    settings = settings or Settings()
    source = DataSet.open(data, allow_missing)
    trials = read_split(source, split)
    if not trials.train:  # those in missing parts are left out already
        raise InputError(f"split {split!r} of {data} has no training trial; make another with cutgrammar split")
    provenance = Provenance(source.digest, split, trials.digest, trials.train, seed)
    if (out / "model.json").exists():
        return Trained(out, _the_same(out, settings, provenance, vision), None)
    return _learned(source, out, settings, provenance, vision)


def _learned(source: DataSet, out: Path, settings: Settings, provenance: Provenance, vision: bool) -> Trained:
    """A model learned anew and saved."""
    check_place(out)
    demonstrations = [source.demonstration(trial) for trial in provenance.trials]
    if not any(not cut.undone for demonstration in demonstrations for cut in demonstration.cuts):
        raise InputError(
            f"the training trials of split {provenance.split!r} of {source.path} hold no cut; collect more"
        )
    with _stages() as watch:
        learned = learn(demonstrations, settings, provenance, watch, _scenes if vision else None)
    save_model(learned.model, out)
    print(f"{out} holds the model of {len(demonstrations)} training trials")
    print(describe(learned.model.grammar))
    return Trained(out, learned.model, learned)


def _scenes(
    demonstrations: Sequence[Demonstration], settings: Settings, seed: int, on_scene: Callable[[int], Any]
) -> list[LabelledCloud]:
    from cutgrammar_sim.cameras.scenes import seen_scenes  # the simulator and the cameras are not wanted otherwise

    return seen_scenes(demonstrations, settings, seed, settings.vision.n_scenes, on_scene)


def _the_same(out: Path, settings: Settings, provenance: Provenance, vision: bool) -> Model:
    """The model in `out`, if it is the one asked for."""
    model = load_model(out)
    if vision != (model.segmentation is not None):
        has, asked = ("no", "with") if vision else ("a", "without")
        raise InputError(f"{out} holds a model with {has} segmentation; train {asked} --vision into another --out")
    there, wanted = (
        {"settings": asdict(settings_used(made, vision)), **asdict(came)}
        for made, came in ((model.settings, model.provenance), (settings, provenance))
    )
    if told := first_difference(there, wanted):
        raise InputError(f"{out} holds a model with {told}; give the same, or choose another --out")
    print(f"{out} holds this model already; nothing to do")
    return model


@contextmanager
def _stages() -> Iterator[Watch]:
    """One bar for each stage, closed as the next one begins."""
    with ExitStack() as bars:
        stage, so_far = "", 0
        advance: Advance = _nowhere

        def watch(name: str, done: int, total: int) -> None:
            nonlocal stage, so_far, advance
            if name != stage:
                bars.pop_all().close()
                stage, so_far = name, 0
                advance = bars.enter_context(progress(name, total))
            advance(done - so_far)
            so_far = done

        yield watch


def _nowhere(_: int = 1) -> None:
    """Advances nothing."""
