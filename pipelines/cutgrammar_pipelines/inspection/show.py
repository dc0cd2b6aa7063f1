"""The content of a data set, a model or a run, checked against its digests, as text or as pictures."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from cutgrammar.errors import InputError, listed
from cutgrammar.results.arm_work import ArmWork, arm_work
from cutgrammar.storage.shared_storage import local_folder
from cutgrammar_pipelines.config import ShowConfig


def show(config: ShowConfig) -> int:
    """Print what a data set, a model or a run contains or, with `config.out`, draw it.

    Raises:
        InputError: the folder is none of the three, a file in it is damaged, missing or foreign, or it cannot be drawn.
    """
    place, out, data = config.place, config.out, config.data
    folder = local_folder(place)
    described = {"manifest.json": _data, "model.json": _model, "run.json": _run}
    marker = next((name for name in described if (folder / name).exists()), None)
    if marker is None:
        reason = "has neither manifest.json, model.json nor run.json" if folder.is_dir() else "is not a folder"
        raise InputError(f"{place} {reason}; give a data set, a model or a run")
    if data is not None and (out is None or marker != "model.json"):
        raise InputError(f"--data {data} is for the picture of a model's grammar; give a model and --out too")
    print("\n".join(described[marker](folder, place) if out is None else map(str, _draw(marker, place, out, data))))
    return 0


def _draw(marker: str, place: str, out: Path, data: str | None) -> Sequence[Path]:
    """Draw what the place with this marker holds; drawing needs matplotlib, which takes a second to import."""
    from cutgrammar_pipelines.inspection.pictures import picture_of_data, pictures_of_model

    if marker == "manifest.json":
        return picture_of_data(place, out)
    if marker == "model.json":
        return pictures_of_model(place, out, data)
    from cutgrammar_pipelines.inspection.run_pictures import pictures_of_run

    return pictures_of_run(place, out)


def _data(folder: Path, place: str) -> list[str]:
    from cutgrammar.storage.data_set import DataSet
    from cutgrammar.storage.split import read_split

    data = DataSet.open(folder)
    for trial in data.trials:
        data.demonstration(trial.trial)
    seed = "" if data.seed is None else f", seed {data.seed}"
    lines = [
        f"data set {place}, digest {data.digest[:16]}, every part whole",
        f"{len(data.trials)} trials{seed}, foods {', '.join(sorted(data.foods))}",
    ]
    for setup, count in sorted(Counter(trial.setup for trial in data.trials).items()):
        trials = [trial for trial in data.trials if trial.setup == setup]
        cuts = sum(trial.cuts for trial in trials)
        fragments = [trial.fragments for trial in trials]
        categories = Counter(category for trial in trials for category in trial.categories)
        numbers = ", ".join(f"{number} {category}" for category, number in sorted(categories.items()))
        size = f"{min(fragments)} to {max(fragments)} fragments"
        lines.append(f"  {setup}: {count} trials ({numbers}), {cuts} cuts, {size}")
    for file in sorted((folder / "splits").glob("*.json")):
        split = read_split(data, file.stem)
        lines.append(f"  split {split.name}: {len(split.train)} trials train, {len(split.test)} test")
    return lines


def _model(folder: Path, place: str) -> list[str]:
    from cutgrammar.grammar.text import describe
    from cutgrammar.learning.model import load_model

    model = load_model(folder)
    source, n_trials = model.provenance, len(model.provenance.trials)
    return [
        f"model {place}, digest {model.digest[:16]}, every file whole",
        f"trained on {n_trials} trials (split {source.split}) of data set {source.data[:16]}, seed {source.seed}",
        *(f"  {name} {value:.4g}" for name, value in sorted(model.metrics.items())),
        describe(model.grammar),
    ]


def _run(folder: Path, place: str) -> list[str]:
    from cutgrammar.storage.ledger import read_planned, read_records
    from cutgrammar.storage.run_folder import ledger_of, read_run

    facts = read_run(folder)
    records = read_records(ledger_of(folder))
    planned = read_planned(ledger_of(folder))
    digests = [digest[:16] for digest in facts.model_digests]
    models = f"model {digests[0]}" if len(digests) == 1 else f"models {', '.join(digests)} (one a run)"
    lines = [
        f"run {place}, {len(records)} of {len(planned)} trials done, every record whole",
        f"data set {facts.data_digest[:16]}, {models}, seed {facts.seed}, "
        f"cutgrammar {facts.package}, commit {facts.commit or 'unknown'}",
    ]
    if facts.missing:
        lines.append(f"without trials {listed(facts.missing)}, which were missing from the data set")
    for status, number in sorted(Counter(record.status for record in records).items()):
        lines.append(f"  {number} {status}")
    for work in arm_work(records):
        lines += _arm(work)
    return lines


def _arm(work: ArmWork) -> list[str]:
    """Lines about the work of the arm for one method."""
    shares = (work.moved / work.cuts, work.turned / work.cuts, work.torque_share, work.velocity_share)
    moved, turned, torque, velocity = (f"{100 * share:.0f} %" for share in shares)
    kept = "all limits kept" if not work.broken else f"LIMITS EXCEEDED in {work.broken} cuts"
    lines = [
        f"  arm of {work.world}, {work.perception}, {work.method}: {work.cuts} cuts in {work.seconds:.0f} s simulated, "
        f"{moved} moved first, {turned} turned",
        f"    at worst: plane off by {work.plane_error_deg:.3f} degrees and {work.plane_error_mm:.3f} mm, torque "
        f"{torque} and velocity {velocity} of their limits, {work.blade_force:.0f} N on "
        f"the blade; {kept}",
    ]
    for outcome, reasons in (("refused", work.refused), ("failed", work.failed)):
        if reasons:
            counts = "; ".join(f"{number} {reason}" for reason, number in reasons)
            lines.append(f"    {sum(number for _, number in reasons)} {outcome}: {counts}")
    return lines
