"""The views of a study in MLflow: first the score that decides, setup by setup, then the settings that differ.

By itself MLflow draws a bar chart of every metric, section by section in the order of the alphabet, for the last ten
runs. It lets a user share a view, which it keeps as a tag of the experiment and opens by a link; these functions write
such tags. A section that is not opened here stays there, folded.
"""

import base64
import json
import zlib
from collections.abc import Iterable, Sequence
from typing import Any

from cutgrammar.events import DECIDING_SCORE
from cutgrammar.results.score_table import MEAN
from cutgrammar.trials.setups import SETUPS
from cutgrammar_pipelines.tracking.run_log import KIND, METHOD, TRAINING

VIEW = "mlflow.sharedViewState."
"""Prefix of the tags in which MLflow keeps shared views."""
SCORES, TRAININGS = "scores", "trainings"
"""Names of the views: of the methods and of the models."""
MAX_BARS = 20
"""MLflow shows all runs, or the first ten or twenty; of more than this the best twenty are shown."""
OTHER_NUMBERS = ("ci95_low", "ci95_high", "std_runs", "worst_run")
"""Endings of sections that describe the scatter of others, and therefore come last."""


def views(metrics: Iterable[str], n_methods: int) -> dict[str, str]:
    """The tags of an experiment that hold its views.

    Args:
        metrics: names of all metrics of the top-level runs of methods.
        n_methods: number of these runs.
    """
    scores = _facets(METHOD) | _charts(sorted(set(metrics)))
    scores |= {"runsHiddenMode": "FIRST_20_RUNS" if n_methods > MAX_BARS else "SHOW_ALL"}
    trainings = _facets(TRAINING) | {"runsHiddenMode": "SHOW_ALL"}
    return {f"{VIEW}{name}": _packed(view) for name, view in ((SCORES, scores), (TRAININGS, trainings))}


def link(experiment: str, view: str = SCORES) -> str:
    """The part of a page's address after the server's name."""
    return (
        f"/#/experiments/{experiment}/runs?workflowType=machine_learning&compareRunsMode=CHART&viewStateShareKey={view}"
    )


def note(experiment: str) -> str:
    """The description of a study's experiment, in Markdown: where to find what."""
    return (
        f"[Scores of the methods]({link(experiment)[1:]}) (one run a method; its seeds or models are the runs within) "
        f"and [trainings]({link(experiment, TRAININGS)[1:]}).\n\n"
        f"`{DECIDING_SCORE}/N1M1` is the score that decides in setup N1M1 with goals in place, "
        f"`{DECIDING_SCORE}/scattered/N1M1` with scattered ones; `{MEAN}` is the mean over setups, `all` over trials."
    )


def _facets(kind: str) -> dict[str, Any]:
    """Which runs are listed, and in which order."""
    by_score = kind == METHOD
    return {
        "searchFilter": f"tags.{KIND} = '{kind}'",
        "orderByKey": f"metrics.`{DECIDING_SCORE}/{MEAN}`" if by_score else "attributes.start_time",
        "orderByAsc": False,
        "startTime": "ALL",
        "lifecycleFilter": "Active",
        "datasetsFilter": [],
        "modelVersionFilter": "All Runs",
    }


def _charts(metrics: Sequence[str]) -> dict[str, Any]:
    """The sections and cards of the chart page of methods."""
    sections = sorted({_section_of(name) for name in metrics}, key=_section_place)
    deciding = [name for name in sections if _is_deciding(name)]
    cards = [
        _bars(name, number)
        for number, name in enumerate(sorted(filter(lambda m: _section_of(m) in deciding, metrics), key=_card_place))
    ]
    shown = [
        {"uuid": _id(name), "name": name, "display": name in deciding, "isReordered": True, "isGenerated": False}
        for name in sections
    ]
    differences = "settings that differ"
    shown.insert(1, {"uuid": _id(differences), "name": differences, "display": True, "isReordered": True})
    cards.append(
        {
            "uuid": "differences",
            "type": "DIFFERENCE",
            "metricSectionId": _id(differences),
            "compareGroups": ["Parameters"],
            "chartName": "Settings that differ between the runs shown",
            "showChangeFromBaseline": False,
            "showDifferencesOnly": True,
            "baselineColumnUuid": "",
            "deleted": False,
            "isGenerated": False,
        }
    )
    columns = [f"metrics.`{name}`" for name in metrics if _section_of(name) == DECIDING_SCORE]
    return {
        "compareRunCharts": cards,
        "compareRunSections": shown,
        "isAccordionReordered": True,
        "hideEmptyCharts": True,
        "selectedColumns": sorted(columns, key=lambda column: _card_place(column.split("`")[1])),
        "viewMaximized": False,
        "runListHidden": False,
        "useGroupedValuesInCharts": True,
        "groupBy": None,
        "chartsSearchFilter": "",
    }


def _bars(name: str, number: int) -> dict[str, Any]:
    """A bar chart of one metric; the mean over trials is left to those who look for it."""
    return {
        "uuid": f"bars{number}",
        "type": "BAR",
        "metricKey": name,
        "displayName": name.rsplit("/", 1)[1],
        "metricSectionId": _id(_section_of(name)),
        "runsCountToCompare": MAX_BARS,
        "deleted": name.endswith("/all"),
        "isGenerated": False,
    }


def _section_of(name: str) -> str:
    return name.rpartition("/")[0]


def _is_deciding(section: str) -> bool:
    return section.split("/")[0] == DECIDING_SCORE


def _section_place(section: str) -> tuple[bool, bool, bool, str]:
    """The deciding score, under each goal condition, then other scores, of people first, then all else by name."""
    first = section.split("/")[0]
    return not _is_deciding(section), first != "human_rating", first.endswith(OTHER_NUMBERS), section


def _card_place(name: str) -> tuple[tuple[bool, bool, bool, str], bool, int, str]:
    """The mean over setups, then the setups in the order of Table I."""
    section, _, setup = name.rpartition("/")
    order = [MEAN, *SETUPS]
    return _section_place(section), setup == "all", order.index(setup) if setup in order else len(order), setup


def _id(section: str) -> str:
    return f"section {section}"


def _packed(view: dict[str, Any]) -> str:
    """As MLflow's own pages write it; a tag of an experiment has at most 20,000 characters."""
    return "deflate;" + base64.b64encode(zlib.compress(json.dumps(view).encode(), 9)).decode()
