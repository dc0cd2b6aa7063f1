"""Another arm than the Gen3, from a URDF file: its text becomes a setting, so that it travels to every worker."""

import dataclasses
from pathlib import Path

from cutgrammar.errors import InputError
from cutgrammar.settings import Settings
from cutgrammar_sim.arm.robot.urdf import read_urdf

LARGEST = 4_000_000
"""Bytes of a URDF file that is read at the most."""


def with_arm(settings: Settings, urdf: Path | None, flange: str | None) -> Settings:
    """The settings with the arm that `urdf` describes, the tool on its link `flange`; unchanged without a file.

    Raises:
        InputError: only one of the two is given, the file cannot be read, or does not describe such an arm.
    """
    if urdf is None and flange is None:
        return settings
    if urdf is None or flange is None:
        raise InputError(
            "--arm and --flange go together: the URDF of an arm and the name of the link that the tool is fixed to"
        )
    try:
        if urdf.stat().st_size > LARGEST:
            raise InputError(f"{urdf} has more than {LARGEST} bytes; the URDF of one arm is expected")
        text = urdf.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"the arm's URDF {urdf} cannot be read: {error}") from None
    try:
        read_urdf(text, flange)
    except InputError as error:
        raise InputError(f"{urdf}: {error}") from None
    return dataclasses.replace(settings, kinova=dataclasses.replace(settings.kinova, urdf=text, flange=flange))
