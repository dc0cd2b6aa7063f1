"""One frozen class for each command: the command line, the Python functions and the study file all build these.

A config is checked when it is built. Its docstring is the help text of the command.
"""

from cutgrammar_pipelines.config.data import CollectConfig, SplitConfig
from cutgrammar_pipelines.config.evaluation import EvaluateConfig, PlanConfig
from cutgrammar_pipelines.config.results import (
    ExportConfig,
    FilmConfig,
    ReportConfig,
    ShowConfig,
    SyncConfig,
    ViewConfig,
)
from cutgrammar_pipelines.config.services import MlflowConfig, StudyConfig
from cutgrammar_pipelines.config.training import TrainConfig

__all__ = [
    "CollectConfig",
    "EvaluateConfig",
    "ExportConfig",
    "FilmConfig",
    "MlflowConfig",
    "PlanConfig",
    "ReportConfig",
    "ShowConfig",
    "SplitConfig",
    "StudyConfig",
    "SyncConfig",
    "TrainConfig",
    "ViewConfig",
]
