"""Pictures of a model's grammar and of a data set's demonstrations.

A model contains no fragments: its types are shown by fragments of the data set that it was trained on. If no data set
is given, it is found by its digest in the folders beside the model and beside the model's parent folder; for a model at
a URL it must be given.
"""

import hashlib
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from cutgrammar.demonstration import Demonstration
from cutgrammar.errors import InputError
from cutgrammar.learning.model import Model, load_model
from cutgrammar.learning.typical_fragments import typical_fragments
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.shared_storage import absolute, is_url, local_folder
from cutgrammar.storage.stored_demonstrations import StoredDemonstrations
from cutgrammar.storage.tables import TrialSummary
from cutgrammar.trials.setups import SETUPS
from cutgrammar.untrusted import read_regular
from cutgrammar.untrusted.documents import MAX_JSON
from cutgrammar_dashboards.figures.curves import draw_induction
from cutgrammar_dashboards.figures.data_picture import draw_data
from cutgrammar_dashboards.figures.grammar_picture import draw_grammar
from cutgrammar_dashboards.figures.layout.sheet import check_picture_name, write_sheet


def pictures_of_model(place: str | Path, out: Path, data: str | Path | None = None) -> list[Path]:
    """Draw the grammar of the model at `place` to the file `out` or, if that is a folder, also how it was induced.

    Args:
        place: folder or URL of the model.
        out: a file that ends in .svg or .png, or a folder.
        data: folder or URL of the data set that the model was trained on; None searches for it.

    Raises:
        InputError: the model cannot be read, `out` has another suffix, or the data set is not found or is another one.
    """
    if out.suffix:
        check_picture_name(out)
    model, name = load_model(local_folder(place)), Path(absolute(place)).name
    typical = typical_fragments(model, training_trials_of(model, place, data))
    grammar = draw_grammar(model.grammar, typical, f"The grammar of {name}")
    if out.suffix:
        write_sheet(grammar, out)
        return [out]
    files = [out / "grammar.png", out / "induction.png"]
    write_sheet(grammar, files[0])
    write_sheet(draw_induction(model.induction["curve"], model.grammar.k, f"Induction of {name}"), files[1])
    return files


def training_trials_of(model: Model, place: str | Path, data: str | Path | None = None) -> Sequence[Demonstration]:
    """The demonstrations that the model at `place` was trained on.

    Raises:
        InputError: its data set is not found, or `data` is another one.
    """
    data = _data_of(model, place) if data is None else data
    source = DataSet.open(local_folder(data), allow_missing=True)
    if source.digest != model.provenance.data:
        raise InputError(
            f"{data} is not the data set that {place} was trained on: its digest is {source.digest[:16]}, "
            f"not {model.provenance.data[:16]}; name the right one with --data"
        )
    present = [trial for trial in model.provenance.trials if trial not in source.missing]
    return StoredDemonstrations(source, present)


def _data_of(model: Model, place: str | Path) -> Path:
    """The data set that a model was trained on, searched for near its folder.

    Raises:
        InputError: it is not found.
    """
    for parent in () if is_url(place) else Path(place).resolve().parents[:2]:
        for manifest in sorted(parent.glob("*/manifest.json")):
            with suppress(InputError, OSError):
                if hashlib.sha256(read_regular(manifest, MAX_JSON)).hexdigest() == model.provenance.data:
                    return manifest.parent
    raise InputError(
        f"the data set that {place} was trained on (digest {model.provenance.data[:16]}), whose fragments show what "
        "its types look like, is not in a folder beside it; name it with --data"
    )


def picture_of_data(place: str | Path, out: Path, examples: int = 4) -> list[Path]:
    """Draw examples of every setup in the data set at `place` to `out` (the paper's Fig. 3).

    Args:
        place: folder or URL of the data set.
        out: a file that ends in .svg or .png.
        examples: maximum number for each setup.

    Raises:
        InputError: the data set cannot be read, or `out` has another suffix.
    """
    check_picture_name(out)
    source = DataSet.open(local_folder(place))
    chosen = {
        setup: [
            source.demonstration(trial) for trial in _varied([t for t in source.trials if t.setup == setup], examples)
        ]
        for setup in SETUPS
        if any(trial.setup == setup for trial in source.trials)
    }
    write_sheet(draw_data(chosen, f"Demonstrations of {Path(absolute(place)).name}, by setup"), out)
    return [out]


def _varied(trials: Sequence[TrialSummary], count: int) -> list[int]:
    """The numbers of `count` trials whose categories and foods vary most; of equal ones, the first are taken."""
    shown: Counter[str] = Counter()
    chosen: list[TrialSummary] = []
    while len(chosen) < min(count, len(trials)):
        rest = [trial for trial in trials if trial not in chosen]
        chosen.append(min(rest, key=lambda trial: sum(shown[name] for name in (*trial.categories, *set(trial.foods)))))
        shown.update((*chosen[-1].categories, *chosen[-1].foods))
    return sorted(trial.trial for trial in chosen)
