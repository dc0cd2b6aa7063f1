"""Sheets and their files; fragments side by side and apart."""

import numpy as np
import pytest

from cutgrammar.errors import InputError
from cutgrammar.geometry.canonical import FLIPS
from cutgrammar_dashboards.figures.layout.sheet import (
    PORTRAIT,
    new_sheet,
    portrait,
    scale_to_fit,
    seen_size,
    write_sheet,
)
from cutgrammar_dashboards.figures.layout.spread import apart, fitting_scale, laid_out
from cutgrammar_dashboards.rendering.drawing import FRONT


@pytest.fixture
def pieces(story):
    _, goal, _ = story
    return [portrait(fragment.shape, (200, 120, 40)) for fragment in goal]


def drawn(bodies):
    with new_sheet(2.0, 1.0) as sheet:
        sheet.place(bodies, PORTRAIT, (1.0, 0.5), scale_to_fit(bodies, PORTRAIT, 1.0, 0.8))
        sheet.write(0.1, 0.1, "$x <b>")
    return sheet.figure


@pytest.mark.parametrize(("name", "magic"), [("a.png", b"\x89PNG"), ("deep/b.svg", b"<?xml")])
def test_the_suffix_decides_the_format_and_the_bytes_are_reproducible(tmp_path, pieces, name, magic):
    contents = []
    for folder in ("once", "again"):
        write_sheet(drawn(pieces[:1]), tmp_path / folder / name)
        contents.append((tmp_path / folder / name).read_bytes())
    assert contents[0] == contents[1]
    assert contents[0].startswith(magic)


def test_another_suffix_is_an_input_error(tmp_path, pieces):
    with pytest.raises(InputError, match=r"is not the name of a picture; use one that ends in \.svg or \.png"):
        write_sheet(drawn(pieces[:1]), tmp_path / "a.jpeg")


def test_a_portrait_has_its_longest_axis_to_the_right(story):
    start, _, _ = story
    body = portrait(start[0].shape, (1, 2, 3), FLIPS[2])
    assert np.argsort(np.ptp(body.vertices, axis=0)).tolist()[-1] == 0


def test_bodies_laid_out_do_not_overlap_and_fit(pieces):
    scale = fitting_scale([pieces, pieces[:2]], PORTRAIT, 1.2, 0.8, 0.05)
    bodies = laid_out(pieces, PORTRAIT, 1.2 / scale, 0.05 / scale)
    width, height = seen_size(bodies, PORTRAIT)
    assert scale * width + 0.05 <= 1.2 + 1e-9
    assert scale * height + 0.05 <= 0.8 + 1e-9
    boxes = [body.vertices @ PORTRAIT.axes.T for body in bodies]
    for i, a in enumerate(boxes):
        for b in boxes[i + 1 :]:
            gaps = np.maximum(a.min(axis=0) - b.max(axis=0), b.min(axis=0) - a.max(axis=0))
            assert gaps.max() >= 0.0


def test_the_fitting_scale_is_nearly_the_greatest(pieces):
    scale = fitting_scale([pieces], PORTRAIT, 1.2, 0.8, 0.05)
    larger = 1.06 * scale
    width, height = seen_size(laid_out(pieces, PORTRAIT, 1.2 / larger, 0.05 / larger), PORTRAIT)
    assert larger * width + 0.05 > 1.2 or larger * height + 0.05 > 0.8
    assert max(scale * seen_size([body], PORTRAIT)[0] for body in pieces) < 1.2


def test_groups_move_apart_and_no_fragment_sinks(story):
    _, goal, _ = story
    shifts = apart(goal, [0, 0, 1, 1], within=0.5, between=1.0)
    assert min(shift[2] for shift in shifts) == pytest.approx(0.0)
    before = np.array([fragment.p_WC for fragment in goal])
    after = before + shifts
    assert np.linalg.norm(after[0] - after[3]) > np.linalg.norm(before[0] - before[3])


def test_the_seen_size_of_a_body_decides_the_scale_that_fits(pieces):
    wide, high = seen_size(pieces[:1], FRONT)
    assert scale_to_fit(pieces[:1], FRONT, 2.0 * wide, 9.0 * high) == pytest.approx(2.0)
