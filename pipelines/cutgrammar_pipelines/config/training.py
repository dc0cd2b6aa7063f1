"""The config of `train`."""

from pydantic.dataclasses import dataclass

from cutgrammar_pipelines.config.options import (
    CHECKED,
    DEFAULT,
    FolderOrUrl,
    LocalPath,
    Seed,
    SettingsOption,
    UnusedAddress,
    UnusedWorkers,
    WatchOption,
)


@dataclass(frozen=True, kw_only=True, config=CHECKED)
class TrainConfig:
    """Learn everything from the training trials: encoder, fragment types, grammar, classifier, cutting planes.

    Every part is logged to MLflow: its curves, the choice of k, the productions (see cutgrammar mlflow). The same
    arguments give the same bytes; if --out already holds this model, nothing is done.

    Example:
      cutgrammar train --data data --out model

    Attributes:
        data: data set with a split; a folder, or a URL of shared storage (s3://...).
        out: folder of the model to make.
        split: name of the split.
        vision: also learn to segment the clouds of the depth cameras, from simulated scenes of the training foods.
            This takes some minutes more; evaluate --perception cameras needs it.
        allow_missing: continue without parts of the data set that are missing or damaged.
        watch: show the curves while they are computed, in a rerun viewer that is opened, or in the one at this port or
            URL; never changes a result.
    """

    data: FolderOrUrl
    out: LocalPath
    split: str = "paper"
    vision: bool = False
    allow_missing: bool = False
    watch: WatchOption = None
    seed: Seed = 0
    settings: SettingsOption = DEFAULT
    workers: UnusedWorkers = None
    address: UnusedAddress = None
