"""Every setting with its default and its bounds, in one small class for each part of the system.

`Settings` holds them all. A TOML file with one table for each part, e.g. `[search]`, changes some of them.
"""

from cutgrammar.settings.all import Settings
from cutgrammar.settings.files import from_tables, in_one_line, load_settings, read_tables, validated
from cutgrammar.settings.fitting import FittingLevel, FittingSettings
from cutgrammar.settings.learning import (
    BaselineSettings,
    ClassifierSettings,
    FeatureSettings,
    InductionSettings,
    PlaneSettings,
    VisionSettings,
)
from cutgrammar.settings.planning import CuttingSettings, PlusSettings, SearchSettings, TrialSettings
from cutgrammar.settings.simulation import CameraSettings, DemonstratorSettings, KinovaSettings, WorldSettings

__all__ = [
    "BaselineSettings",
    "CameraSettings",
    "ClassifierSettings",
    "CuttingSettings",
    "DemonstratorSettings",
    "FeatureSettings",
    "FittingLevel",
    "FittingSettings",
    "InductionSettings",
    "KinovaSettings",
    "PlaneSettings",
    "PlusSettings",
    "SearchSettings",
    "Settings",
    "TrialSettings",
    "VisionSettings",
    "WorldSettings",
    "from_tables",
    "in_one_line",
    "load_settings",
    "read_tables",
    "validated",
]
