"""The page: whole by itself, escaped, and drawn the same every time."""

import dataclasses
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from cutgrammar.geometry.fragment import Cloud, Fragment
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.results.arm_work import ArmWork
from cutgrammar_dashboards.figures.trial_picture import trial_picture
from cutgrammar_dashboards.recording.read_back import configurations_of
from cutgrammar_dashboards.recording.recorder import make_recorder
from cutgrammar_dashboards.report.page import PageDetails, Picture, WorstTrial, page, write_page
from cutgrammar_dashboards.report.score_charts import colours_of, score_chart

EVIL = "<script>alert('&\"$x$')</script>"


def row(setup, method, strict, **changes):
    return {
        "setup": setup,
        "goals": "in-place",
        "world": "bench",
        "perception": "truth",
        "method": method,
        "trials": 3,
        "iou_mean": strict,
        "iou_strict_mean": strict,
        "iou_refined_mean": None,
        "spectral_mean": None,
        "agreement_mean": None,
        "iou_std_runs": None,
        "iou_strict_std_runs": 0.02,
        "iou_strict_ci95": [strict - 0.05, strict + 0.05],
        "cuts_mean": 4.0,
        "failures": 0,
        "stuck": 1,
        "dead_ends": 0,
        "seconds_mean": 0.5,
        "digest": "1f" * 32,
        **changes,
    }


CONDITION = {"goals": "in-place", "world": "bench", "perception": "truth"}


def report_of(rows, tests=(), **changes):
    methods = list(dict.fromkeys(r["method"] for r in rows))
    points = {"thresholds": [0.0, 0.5, 1.0], "share": [1.0, 0.5, 0.0]}
    return {
        "schema": 1,
        "rows": rows,
        "tests": list(tests),
        "setup_means": [next(r for r in rows if r["method"] == m) | {"setups": 1} for m in methods],
        "improvement": [
            {
                **CONDITION,
                "setup": t["setup"],
                "method": "grammar",
                "over": t["method"],
                "probability": 0.9,
                "ci95": None,
            }
            for t in tests
        ],
        "profiles": [{**CONDITION, "setup": "all", "method": m, "ci95": None, **points} for m in methods],
        "paper": [{"setup": "N1M1", "method": m, "iou_mean": 0.58, "iou_std": 0.08} for m in ("bc", "grammar")],
        "shown": [],
        "digest": "0a" * 32,
        **changes,
    }


def report():
    test = {"against": "grammar", "trials": 3, "mean_difference": -0.3, "ci95": None}
    test |= {"p_value": 0.0001, "p_corrected": None}
    rows = [row(s, m, v) for s in ("N1M1", "all") for m, v in (("grammar", 0.6), (EVIL, 0.3))]
    tests = [{**CONDITION, "setup": s, "method": EVIL, **test} for s in ("N1M1", "all")]
    return report_of(rows, tests, notes=[EVIL], shown=[EVIL], digest=EVIL)


@pytest.fixture(scope="module")
def details(story):
    start, goal, events = story
    return PageDetails(
        differences={("in-place", "bench", "truth"): {EVIL: {"N1M1": [-0.3, -0.2], "N2M1": [0.1]}}},
        worst=[WorstTrial(EVIL, "stuck", EVIL, 0.1, "3 of 4", EVIL, 'x".rrd')],
        recordings=[(EVIL, "run/a.rrd")],
        pictures=[Picture(EVIL, start, goal, events[-2].configuration, ((0, 0), (1, 1)))],
        provenance=[("settings", EVIL)],
    )


@pytest.fixture(scope="module")
def text(details):
    return page(report(), EVIL, details)


class Reader(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.ids, self.addresses, self.open = [], [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            if name in ("src", "href", "xlink:href"):
                self.addresses.append(value)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in ("meta", "img", "br"):
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def read(text):
    reader = Reader()
    reader.feed(text)
    reader.close()
    assert reader.open == []
    return reader


def test_nothing_foreign_is_written_unescaped(text):
    assert "script" not in read(text).tags
    assert "<script" not in text
    assert "alert(" in text


def test_the_page_asks_nothing_of_the_network(text):
    reader = read(text)
    assert {"link", "iframe", "script"} & set(reader.tags) == set()
    for address in reader.addresses:
        assert address.startswith(("data:image/png;base64,", "#")) or address in ("run/a.rrd", 'x".rrd')
    style = re.search(r"<style>(.*?)</style>", text, re.DOTALL).group(1)
    assert "url(" not in style
    assert "@import" not in style


def test_ids_are_used_once_and_letters_take_the_colour_of_the_page(text):
    reader = read(text)
    assert len(reader.ids) == len(set(reader.ids))
    targets = set(re.findall(r'(?:href="#|url\(#)([^")]+)', text))
    assert targets <= set(reader.ids)
    assert "currentColor" in text
    assert "#0a0b0c" not in text


def test_the_same_report_gives_the_same_bytes(details, text):
    assert page(report(), EVIL, details) == text


def test_figures_and_pictures_have_words_for_those_who_do_not_see_them(text):
    assert text.count('role="img" aria-label="') == 4
    assert 'alt="start, goal with 4 fragments, and the 4 fragments reached"' in text
    assert '<html lang="en">' in text


def test_unknown_scores_are_dashes_and_missing_timing_leaves_no_column():
    rows = [{k: v for k, v in row("all", "grammar", 0.5).items() if k != "seconds_mean"}]
    rows[0] |= {"iou_mean": None, "iou_strict_ci95": None, "iou_strict_std_runs": None}
    text = page(report_of(rows), "Scores", PageDetails())
    assert "<td>&ndash;</td>" in text
    assert "seconds" not in text
    assert "None" not in re.sub(r"None is given", "", text)


def test_a_page_without_rows_says_so(tmp_path):
    write_page(report_of([]), tmp_path / "a" / "page.html", "Scores", PageDetails())
    assert "No trial has been evaluated yet" in (tmp_path / "a" / "page.html").read_text()


def test_the_chart_shows_every_method_of_every_setup():
    rows = [row(s, f"m{k}", 0.1 * k + 0.1) for s in ("N1M1", "N2M1", "all") for k in range(5)]
    svg = score_chart(rows, colours_of(r["method"] for r in rows), "m0", "salt")
    assert all(f">{name}</text>" in svg for name in ("N1M1", "N2M1", "all", "m0", "m4"))


def test_clouds_and_empty_configurations_are_drawn(story):
    start, goal, _ = story
    seen = tuple(Fragment(Cloud(c.points, c.normals), f.X_WF) for f in goal for c in [sample_surface(f.mesh, 50)])
    assert trial_picture(start, seen, (), ()).startswith("<img alt=")


def test_what_is_read_back_from_a_recording_is_what_was_recorded(tmp_path, story, random_pose):
    start, goal, events = story
    goal = tuple(Fragment(fragment.shape, random_pose()) for fragment in goal)
    path = tmp_path / "trial.rrd"
    recorder = make_recorder(str(path), "a trial", start, goal)
    for event in events:
        recorder(event)
    recorder.close()
    for told, read_back in zip((start, goal, events[-2].configuration), configurations_of(path), strict=True):
        assert len(told) == len(read_back)
        for a, b in zip(told, read_back, strict=True):
            assert b.mesh.volume == pytest.approx(a.mesh.volume, rel=1e-4)
            assert np.abs(a.p_WC - b.p_WC).max() < 1e-6
            assert np.abs(a.X_WF.rotation - b.X_WF.rotation).max() < 1e-6


def test_a_recording_that_ends_early_shows_nothing(tmp_path, story):
    start, goal, events = story
    path = tmp_path / "trial.rrd"
    recorder = make_recorder(str(path), "a trial", start, goal)
    recorder(events[0])
    recorder.close()
    assert configurations_of(path) is None


def test_how_an_arm_cut_is_told_with_its_reasons_and_only_where_one_did():
    kept = ArmWork("kinova", "truth", "grammar", 200, 60, 40, 0.012, 0.034, 0.81, 0.75, 43.2, 0, 2100.0, (), ())
    broken = dataclasses.replace(kept, method=EVIL, broken=3, refused=((EVIL, 7),), failed=(("slipped", 2),))
    shown = page(report(), "scores", PageDetails(arm=[kept, broken]))
    assert '<a href="#arm">' in shown
    assert "<td>200</td><td>30 %</td><td>20 %</td><td>0</td><td>0</td><td>0.012</td><td>0.034</td><td>81 %" in shown
    assert '<tr class=bad><th scope="row">' in shown
    assert "slipped" in shown
    assert EVIL not in shown
    without = page(report(), "scores", PageDetails(arm=[kept]))
    assert "Why cuts were refused" not in without
    assert "How the arm cut" not in page(report(), "scores", PageDetails())
