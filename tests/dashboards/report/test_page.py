"""The page: complete in itself, escaped, and drawn the same every time."""

import base64
import dataclasses
import hashlib
import html
import re
from html.parser import HTMLParser

import pytest

from cutgrammar.geometry.fragment import Cloud, Fragment
from cutgrammar.geometry.sampling import sample_surface
from cutgrammar.results.arm_work import ArmWork
from cutgrammar.results.evaluation_report import evaluation_report
from cutgrammar.results.report import (
    Cell,
    Dot,
    DotChart,
    Panel,
    Row,
    Section,
    Table,
    TrialPicture,
    TrialResult,
    keys,
    words,
)
from cutgrammar.results.score_table import Row as LedgerRow
from cutgrammar.results.trial_sections import (
    arm_section,
    pictures_section,
    recordings_section,
    view_command,
    worst_section,
)
from cutgrammar.trials.record import Record, TrialKey
from cutgrammar_dashboards.figures.trial_picture import trial_picture
from cutgrammar_dashboards.report.charts import colours_of, draw_dots
from cutgrammar_dashboards.report.page import page, write_page

TARGETS = ("run/a.rrd", "x%22.rrd", "%3Cscript%3Ealert%28%27%26%22%24x%24%27%29%3C/script%3E/a.rrd")
EVIL = "<script>alert('&\"$x$')</script>"


def record(setup, trial, method, strict, **scores):
    key = TrialKey(setup, trial, "in-place", method, 0, "bench", "truth", "o")
    pairs = ({"event": "Scored", "pairs": [[0, 0, 0.5], [1, 1, 0.5]]},)
    found = {"iou_strict": strict, "iou": strict} | scores
    return Record(key, "0.1.0", None, "stuck", EVIL, None, found, 3, 4, 2, 1, 0, 0.1, 0.2, pairs)


RECORDS = [
    record(setup, 10 * s + trial, method, level + 0.01 * trial)
    for s, setup in enumerate(("N1M1", "N2M1"))
    for trial in range(3)
    for method, level in (("grammar", 0.6), (EVIL, 0.3))
]


def trial_of(story, run, **changes):
    start, goal, events = story
    reached, pairs = events[-2].configuration, events[-1].pairs
    result = TrialResult("reached", EVIL, reached, pairs, view_command(run, EVIL), run / "a.rrd")
    return dataclasses.replace(TrialPicture(f"{EVIL}: worst", start, goal, (result,), EVIL), **changes)


def rows_of(records):
    return [LedgerRow(one, "d") for one in records]


@pytest.fixture(scope="module")
def report(story, tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    recordings = {RECORDS[0].key: folder / 'x".rrd', RECORDS[1].key: folder / "run" / "a.rrd"}
    provenance = Table("", (*keys("what"), *words("value")), (Row((Cell(EVIL), Cell(EVIL, is_code=True))),))
    sections = [
        pictures_section([trial_of(story, folder / EVIL)]),
        worst_section(RECORDS, {"o": folder / EVIL}, recordings),
        recordings_section(recordings),
        Section(EVIL, (provenance,), EVIL, EVIL),
    ]
    return folder, evaluation_report(rows_of(RECORDS), notes=[EVIL], details=sections)


@pytest.fixture(scope="module")
def text(report):
    folder, built = report
    return page(built, folder)


class Reader(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.ids, self.addresses, self.open = [], [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag not in ("meta", "img", "br", "input"):
            self.open.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            if name in ("src", "href", "xlink:href"):
                self.addresses.append(value)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in ("meta", "img", "br", "input"):
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
    assert read(text).tags.count("script") == text.count("<script") == text.count("</script>") == 2
    assert "<script>" not in text
    assert "alert(" in text


def test_the_only_script_is_the_one_that_the_policy_names(text):
    (script,) = re.findall(r'<script type="module">(.*?)</script>', text, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', html.unescape(text))
    assert policy == (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
        f"script-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"
    )


def test_a_page_without_trials_holds_no_script(tmp_path):
    text = page(evaluation_report(rows_of(RECORDS)), tmp_path)
    assert "<script" not in text
    assert "script-src" not in text


def test_the_page_loads_nothing_from_the_network(text):
    reader = read(text)
    assert {"link", "iframe"} & set(reader.tags) == set()
    for address in reader.addresses:
        assert address.startswith(("data:image/webp;base64,", "#")) or address in TARGETS
    assert not re.search(r"(src|href)=.https?:", text)
    assert "sourceMappingURL" not in text
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


def test_the_same_report_gives_the_same_bytes(report, text):
    folder, built = report
    assert page(built, folder) == text


def test_figures_and_pictures_have_words_for_those_who_cannot_see_them(text):
    assert text.count('role="img" aria-label="') == 4
    assert 'alt="start, goal with 4 fragments, and the 4 fragments reached"' in text
    assert '<html lang="en">' in text


def test_unknown_scores_are_dashes_and_missing_timing_leaves_no_column(tmp_path):
    unknown = [dataclasses.replace(one, scores=one.scores | {"spectral": None}) for one in RECORDS[1:2]]
    built = evaluation_report(rows_of([*unknown, record("N1M1", 9, "grammar", 0.5, spectral=0.2)]), timing=False)
    text = page(built, tmp_path)
    assert "<td>–</td>" in text
    assert "seconds" not in text
    assert "None" not in text


def test_a_page_without_rows_says_so(tmp_path):
    write_page(evaluation_report([]), tmp_path / "a" / "page.html")
    assert "No trial has been evaluated yet" in (tmp_path / "a" / "page.html").read_text()


def test_a_chart_shows_every_line_of_every_panel():
    names = tuple(f"m{k}" for k in range(5))
    dots = tuple(Dot(name, name, 0.1 * k, (0.0, 0.5)) for k, name in enumerate(names))
    panels = tuple(Panel(setup, dots, 0.1) for setup in ("N1M1", "N2M1", "all"))
    svg = draw_dots(DotChart("", "", names, panels), colours_of(names), "salt")
    assert all(f">{name}</text>" in svg for name in ("N1M1", "N2M1", "all", "m0", "m4"))


def test_clouds_and_empty_configurations_are_drawn(story):
    start, goal, _ = story
    seen = tuple(Fragment(Cloud(c.points, c.normals), f.X_WF) for f in goal for c in [sample_surface(f.mesh, 50)])
    assert trial_picture(start, seen, [((), ())]).startswith("<img alt=")


def test_how_an_arm_cut_is_told_with_its_reasons(tmp_path):
    kept = ArmWork("kinova", "truth", "grammar", 200, 60, 40, 3, 0.012, 0.034, 0.81, 0.75, 43.2, 0, 2100.0, (), ())
    broken = dataclasses.replace(kept, method=EVIL, broken=3, refused=((EVIL, 7),), failed=(("slipped", 2),))

    def shown(*works):
        return page(evaluation_report(rows_of(RECORDS), details=[arm_section(works)]), tmp_path)

    text = shown(kept, broken)
    assert "<td>200</td>" in text
    assert "<td>30%</td>" in text
    assert '<tr class="bad">' in text
    assert "slipped" in text
    assert EVIL not in text
    assert "Why cuts were refused" not in shown(kept)
