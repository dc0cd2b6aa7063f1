"""Another arm by its URDF: its text becomes a setting, and errors are one line."""

from pathlib import Path

import pytest

from cutgrammar.errors import InputError
from cutgrammar.settings import Settings
from cutgrammar_pipelines.stages.arms import MAX_BYTES, with_arm

UR5E = Path(__file__).parents[2] / "data" / "ur5e.urdf"


def test_without_a_file_the_settings_are_left_as_they_are():
    settings = Settings()
    assert with_arm(settings, None, None) is settings


def test_the_text_of_the_file_and_the_flange_become_settings_and_nothing_else_changes():
    changed = with_arm(Settings(), UR5E, "flange")
    assert changed.kinova.urdf == UR5E.read_text()
    assert changed.kinova.flange == "flange"
    assert changed.world == Settings().world


def test_an_arm_that_cannot_make_a_simple_cut_is_refused_at_the_start(tmp_path):
    weak = tmp_path / "weak.urdf"
    weak.write_text(UR5E.read_text().replace('effort="150"', 'effort="5"'))
    assert weak.read_text() != UR5E.read_text()
    with pytest.raises(InputError, match=r"weak\.urdf: with the tool on 'flange' the arm cannot halve a carrot"):
        with_arm(Settings(), weak, "flange")


def test_a_file_that_is_no_arm_is_refused_by_its_name(tmp_path):
    with pytest.raises(InputError, match=r"ur5e\.urdf: .*hand"):
        with_arm(Settings(), UR5E, "hand")
    with pytest.raises(InputError, match=r"none\.urdf cannot be read"):
        with_arm(Settings(), tmp_path / "none.urdf", "flange")
    garbled, huge = tmp_path / "garbled.urdf", tmp_path / "huge.urdf"
    garbled.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"garbled\.urdf cannot be read"):
        with_arm(Settings(), garbled, "flange")
    with huge.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(InputError, match=r"huge\.urdf has more than"):
        with_arm(Settings(), huge, "flange")
