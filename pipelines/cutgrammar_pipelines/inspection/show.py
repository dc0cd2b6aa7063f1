"""The content of a data set, a model or a run, checked against its digests, in words and in pictures."""

from collections import Counter
from pathlib import Path

from cutgrammar.errors import InputError
from cutgrammar.results.arm_work import ArmWork, arm_work


def show(folder: Path, out: Path | None = None, data: Path | None = None) -> int:
    """Print what `folder` holds or, with `out`, draw it.

    Args:
        folder: a data set, a model or a run.
        out: the file of the picture or, of a run, the folder of its pictures.
        data: the data set that a model was trained on; None looks for it beside the model.

    Raises:
        InputError: it holds none of the three, a file in it is damaged, missing or foreign, or it cannot be drawn.
    """
    for marker, tell, draw in (
        ("manifest.json", _data, _draw_data),
        ("model.json", _model, _draw_model),
        ("run.json", _run, _draw_run),
    ):
        if (folder / marker).exists():
            if data is not None and (out is None or marker != "model.json"):
                raise InputError(f"--data {data} is for the picture of a model's grammar; give a model and --out too")
            print("\n".join(tell(folder) if out is None else [str(file) for file in draw(folder, out, data)]))
            return 0
    what = "has neither manifest.json, model.json nor run.json" if folder.is_dir() else "is not a folder"
    raise InputError(f"{folder} {what}; give a data set, a model or a run")


def _draw_data(folder: Path, out: Path, _: Path | None) -> list[Path]:
    from cutgrammar_pipelines.inspection.pictures import (
        picture_of_data,  # drawing needs matplotlib, which takes a second
    )

    return picture_of_data(folder, out)


def _draw_model(folder: Path, out: Path, data: Path | None) -> list[Path]:
    from cutgrammar_pipelines.inspection.pictures import pictures_of_model

    return pictures_of_model(folder, out, data)


def _draw_run(folder: Path, out: Path, _: Path | None) -> list[Path]:
    from cutgrammar_pipelines.inspection.run_pictures import pictures_of_run

    return pictures_of_run(folder, out)


def _data(folder: Path) -> list[str]:
    from cutgrammar.storage.data_set import DataSet
    from cutgrammar.storage.split import read_split

    data = DataSet.open(folder)
    lines = [
        f"data set {folder}, digest {data.digest[:16]}, every part whole",
        f"{len(data.trials)} trials, seed {data.seed}, foods {', '.join(sorted(data.foods))}",
    ]
    for setup, count in sorted(Counter(trial.setup for trial in data.trials).items()):
        mine = [trial for trial in data.trials if trial.setup == setup]
        cuts = sum(trial.cuts for trial in mine)
        fragments = [trial.fragments for trial in mine]
        categories = Counter(category for trial in mine for category in trial.categories)
        told = ", ".join(f"{number} {category}" for category, number in sorted(categories.items()))
        lines.append(f"  {setup}: {count} trials ({told}), {cuts} cuts, {min(fragments)} to {max(fragments)} fragments")
    for file in sorted((folder / "splits").glob("*.json")):
        split = read_split(data, file.stem)
        lines.append(f"  split {split.name}: {len(split.train)} trials train, {len(split.test)} test")
    return lines


def _model(folder: Path) -> list[str]:
    from cutgrammar.grammar.text import describe
    from cutgrammar.learning.model import load_model

    model = load_model(folder)
    came = model.provenance
    return [
        f"model {folder}, digest {model.digest[:16]}, every file whole",
        f"trained on {len(came.trials)} trials (split {came.split}) of data set {came.data[:16]}, seed {came.seed}",
        *(f"  {name} {value:.4g}" for name, value in sorted(model.metrics.items())),
        describe(model.grammar),
    ]


def _run(folder: Path) -> list[str]:
    from cutgrammar.storage.ledger import read_planned, read_records
    from cutgrammar.storage.run_folder import ledger_of, read_run

    facts = read_run(folder)
    records = read_records(ledger_of(folder))
    planned = read_planned(ledger_of(folder))
    ends = Counter(record.status for record in records)
    lines = [
        f"run {folder}, {len(records)} of {len(planned)} trials done, every record whole",
        f"data set {facts.data_digest[:16]}, model {facts.model_digest[:16]}, seed {facts.seed}, "
        f"cutgrammar {facts.package}, commit {facts.commit or 'unknown'}",
    ]
    if facts.missing:
        lines.append(f"without trials {', '.join(map(str, facts.missing))}, which were missing from the data set")
    for status, number in sorted(ends.items()):
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
    for what, reasons in (("refused", work.refused), ("failed", work.failed)):
        if reasons:
            told = "; ".join(f"{number} {reason}" for reason, number in reasons)
            lines.append(f"    {sum(number for _, number in reasons)} {what}: {told}")
    return lines
