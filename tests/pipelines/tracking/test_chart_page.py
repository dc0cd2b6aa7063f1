import base64
import json
import zlib

import pytest

from cutgrammar.trials.setups import SETUPS
from cutgrammar_pipelines.tracking.chart_page import SCORES, TRAININGS, VIEW, link, views

NAMES = [
    f"{section}/{setup}"
    for section in ("agreement", "iou", "iou_strict", "iou_strict/scattered", "iou_strict_ci95_low", "human_rating")
    for setup in (*SETUPS, "all", "mean")
]


def unpacked(tag):
    assert tag.startswith("deflate;")
    return json.loads(zlib.decompress(base64.b64decode(tag.removeprefix("deflate;"))))


@pytest.fixture(scope="module")
def scores():
    return unpacked(views(NAMES, 14)[f"{VIEW}{SCORES}"])


def test_the_first_section_is_the_score_that_decides_and_the_second_shows_the_settings_that_differ(scores):
    sections = [section["name"] for section in scores["compareRunSections"]]
    assert sections == [
        "iou_strict",
        "settings that differ",
        "iou_strict/scattered",
        "human_rating",
        "agreement",
        "iou",
        "iou_strict_ci95_low",
    ]
    opened = [section["name"] for section in scores["compareRunSections"] if section["display"]]
    assert opened == sections[:3]


def test_the_first_section_reads_as_table_i_the_mean_before_the_setups(scores):
    first = scores["compareRunSections"][0]["uuid"]
    cards = [card for card in scores["compareRunCharts"] if card["metricSectionId"] == first and not card["deleted"]]
    assert [card["metricKey"] for card in cards] == [f"iou_strict/{name}" for name in ("mean", *SETUPS)]


def test_every_card_is_in_a_section_that_is_there(scores):
    there = {section["uuid"] for section in scores["compareRunSections"]}
    assert {card["metricSectionId"] for card in scores["compareRunCharts"]} <= there
    ids = [card["uuid"] for card in scores["compareRunCharts"]]
    assert len(ids) == len(set(ids))


def test_methods_are_listed_best_first_and_without_their_seeds(scores):
    assert scores["searchFilter"] == "tags.kind = 'method'"
    assert (scores["orderByKey"], scores["orderByAsc"]) == ("metrics.`iou_strict/mean`", False)


@pytest.mark.parametrize(("n_methods", "shown"), [(14, "SHOW_ALL"), (100, "FIRST_20_RUNS")])
def test_of_many_methods_the_best_twenty_are_drawn(n_methods, shown):
    assert unpacked(views(NAMES, n_methods)[f"{VIEW}{SCORES}"])["runsHiddenMode"] == shown


def test_a_view_fits_into_a_tag_of_an_experiment():
    many = [f"score{i}/{goals}/{setup}" for i in range(60) for goals in ("scattered", "foreign") for setup in SETUPS]
    assert max(len(tag) for tag in views(NAMES + many, 14).values()) < 20_000


def test_links_name_the_views():
    assert link("7").startswith("/#/experiments/7/runs?")
    assert "compareRunsMode=CHART" in link("7")
    assert link("7").endswith("viewStateShareKey=scores")
    assert link("7", TRAININGS).endswith(TRAININGS)
