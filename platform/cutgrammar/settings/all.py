"""All settings in one value, with one table for each part of the system."""

from dataclasses import field

from pydantic.dataclasses import dataclass

from cutgrammar.settings.bounds import CHECKED
from cutgrammar.settings.fitting import FittingSettings
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


@dataclass(frozen=True, config=CHECKED)
class Settings:
    """All settings; each part of the system reads its own table."""

    demonstrator: DemonstratorSettings = field(default_factory=DemonstratorSettings)
    features: FeatureSettings = field(default_factory=FeatureSettings)
    induction: InductionSettings = field(default_factory=InductionSettings)
    classifier: ClassifierSettings = field(default_factory=ClassifierSettings)
    planes: PlaneSettings = field(default_factory=PlaneSettings)
    baselines: BaselineSettings = field(default_factory=BaselineSettings)
    search: SearchSettings = field(default_factory=SearchSettings)
    plus: PlusSettings = field(default_factory=PlusSettings)
    cutting: CuttingSettings = field(default_factory=CuttingSettings)
    fitting: FittingSettings = field(default_factory=FittingSettings)
    world: WorldSettings = field(default_factory=WorldSettings)
    kinova: KinovaSettings = field(default_factory=KinovaSettings)
    cameras: CameraSettings = field(default_factory=CameraSettings)
    vision: VisionSettings = field(default_factory=VisionSettings)
    trial: TrialSettings = field(default_factory=TrialSettings)
