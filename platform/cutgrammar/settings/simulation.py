"""Settings of what is simulated: the demonstrator, the worlds, the arm and the cameras."""

from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from cutgrammar.settings.bounds import CHECKED, NonNegative, PointCount, Positive, Share, Text, Width


@dataclass(frozen=True, config=CHECKED)
class DemonstratorSettings:
    """The scripted demonstrator's error.

    Attributes:
        offset_error: standard deviation of a plane's offset, as a share of the spacing to its neighbours.
        tilt_error_deg: standard deviation of a plane's tilt [degrees].
    """

    offset_error: Share = 0.10
    tilt_error_deg: Annotated[float, Field(strict=True, ge=0, le=45)] = 2.0


@dataclass(frozen=True, config=CHECKED)
class WorldSettings:
    """Cutting in every world, and the SAPIEN board.

    Attributes:
        min_share: a cut is refused if one of its products has less than this share of the fragment's volume.
        blade_thickness_mm: how far the halves part.
        density: of every food [kg/m3].
        max_settle_seconds: longest simulated time in which the fragments come to rest after a cut.
    """

    min_share: Annotated[float, Field(strict=True, ge=0, le=0.5)] = 1e-3
    blade_thickness_mm: NonNegative = 1.0
    density: Positive = 1000.0
    max_settle_seconds: NonNegative = 2.0


@dataclass(frozen=True, config=CHECKED)
class KinovaSettings:
    """The arm that makes the cuts, and its tool.

    Attributes:
        urdf: text of the URDF of another arm; empty for the Kinova Gen3.
        flange: name of the link of that URDF which the tool is fixed to; its z points out of the flange.
        blade_length_mm, blade_height_mm: of the knife.
        press_speed: speed of the blade's edge during a cut [m/s].
        velocity_share: share of the joints' velocity limits that motions are planned with.
        max_acceleration: of every joint [rad/s2].
        max_tilt_deg: largest angle between a cutting plane and the vertical at which the fragment is cut as it lies,
            without being turned first [degrees].
        toughness: fracture toughness of a food that is not in the world's table, such as a user's mesh [J/m2].
    """

    urdf: Text = ""
    flange: Annotated[str, Field(strict=True, max_length=200, pattern=r"^[^\x00-\x1f\x7f-\x9f]*$")] = ""
    blade_length_mm: Positive = 240.0
    blade_height_mm: Positive = 80.0
    press_speed: Positive = 0.1
    velocity_share: Positive = 0.8
    max_acceleration: Positive = 5.0
    max_tilt_deg: NonNegative = 35.0
    toughness: NonNegative = 724.0


@dataclass(frozen=True, config=CHECKED)
class CameraSettings:
    """The two depth cameras.

    Attributes:
        renderer: "vulkan", "rays" (ray casting), or "auto", which uses Vulkan where a device exists.
        width, height: of an image [pixels].
        depth_noise: standard deviation of the depth at 1 m, growing with its square, as of a stereo sensor [m].
        n_points: of the fused cloud that are kept.
    """

    renderer: Literal["auto", "vulkan", "rays"] = "auto"
    width: Width = 640
    height: Width = 480
    depth_noise: NonNegative = 1e-3
    n_points: PointCount = 8192
