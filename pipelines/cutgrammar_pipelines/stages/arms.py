"""Another arm than the Gen3, from a URDF file: its text becomes a setting, so that it reaches every worker."""

import dataclasses
from pathlib import Path

from cutgrammar.errors import InputError
from cutgrammar.settings import Settings
from cutgrammar.untrusted import check_regular, read_regular

MAX_BYTES = 4_000_000
"""Maximum size of a URDF file."""


def with_arm(settings: Settings, urdf: Path | None, flange: str | None) -> Settings:
    """The settings with the arm that `urdf` describes, the tool on its link `flange`; unchanged without a file.

    Raises:
        InputError: the file cannot be read, does not describe an arm with this link, or describes one that cannot make
            a simple cut.
    """
    if urdf is None or flange is None:
        return settings
    # The planner of the arm takes a second and 80 MB to import.
    from cutgrammar_sim.arm.planning.first_press import why_no_press
    from cutgrammar_sim.arm.planning.rig import rig_of
    from cutgrammar_sim.arm.robot.tool import knife
    from cutgrammar_sim.arm.robot.urdf import read_urdf

    try:
        check_regular(urdf)
        if urdf.stat().st_size > MAX_BYTES:
            raise InputError(f"{urdf} has more than {MAX_BYTES} bytes; the URDF of one arm is expected")
        text = read_regular(urdf, MAX_BYTES).decode()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"the arm's URDF {urdf} cannot be read: {error}") from None
    try:
        arm = read_urdf(text, flange)
    except InputError as error:
        raise InputError(f"{urdf}: {error}") from None
    if reason := why_no_press(rig_of(arm, knife(settings), settings)):
        raise InputError(f"{urdf}: with the tool on {flange!r} the arm cannot halve a carrot on the board: {reason}")
    return dataclasses.replace(settings, kinova=dataclasses.replace(settings.kinova, urdf=text, flange=flange))
