"""The models of an evaluation: one, or several that repeat one training with other seeds."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cutgrammar.errors import InputError
from cutgrammar.learning.model import Model, load_model
from cutgrammar.learning.settings_used import settings_used
from cutgrammar.storage.differences import first_difference
from cutgrammar.storage.shared_storage import local_folder


def load_models(paths: Sequence[str | Path]) -> list[Model]:
    """Read the models in these folders or at these URLs, in their order.

    Several models must be repetitions of one training: the same data, split, settings and version, other seeds. What
    they learned, such as the number of fragment types, may differ.

    Raises:
        InputError: a folder holds no model, a model is given twice, or they differ in more than the seed.
    """
    models = [load_model(local_folder(path)) for path in paths]
    for i, (path, model) in enumerate(zip(paths, models, strict=True)):
        for other, earlier in zip(paths[:i], models[:i], strict=True):
            if earlier.digest == model.digest:
                raise InputError(f"{other} and {path} hold the same model; give each once, or one with --runs")
        if changed := first_difference(_training_of(models[0]), _training_of(model)):
            raise InputError(
                f"{paths[0]} and {path} are no repetitions of one training: {changed}; evaluate them into separate runs"
            )
    return models


def _training_of(model: Model) -> dict[str, Any]:
    """All that repetitions of one training have in common."""
    used = settings_used(model.settings, model.segmentation is not None)
    provenance = {name: value for name, value in asdict(model.provenance).items() if name != "seed"}
    return {"vision": model.segmentation is not None, **provenance, "settings": asdict(used)}
