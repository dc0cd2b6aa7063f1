"""How long MLflow's chart and compare pages of a study take to load, in a browser, with made-up scores.

The runs of a study are drawn at random, with as many metrics, settings and children as those of a real one, and logged
to a store in a temporary folder, which is deleted at the end; their names say that they are synthetic. The time is from
the request to the first bars of the first section, and to the table of settings.

Run: python benchmarks/mlflow_pages.py [--methods 14 100] [--runs 5] [--pictures FOLDER]
"""

import argparse
import contextlib
import dataclasses
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

from cutgrammar.results.score_table import MEAN
from cutgrammar.settings import Settings
from cutgrammar.trials.setups import SETUPS
from cutgrammar_pipelines.tracking.chart_page import link
from cutgrammar_pipelines.tracking.evaluation_logs import metric
from cutgrammar_pipelines.tracking.mlflow_store import log_runs, open_store
from cutgrammar_pipelines.tracking.run_log import KIND, METHOD, RUN, RunLog, Study, flat

GOALS = ("in-place", "scattered", "foreign")
SCORES = ("iou_strict", "iou", "iou_refined", "spectral", "agreement")
SCATTER = ("iou_strict_ci95_low", "iou_strict_ci95_high", "iou_strict_worst_run", *(f"{s}_std_runs" for s in SCORES))
COUNTS = ("cuts", "seconds", "failures", "stuck", "dead_ends")
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"]
LONGEST = 600_000
"""Longest time that a page may take [ms]."""


def main() -> None:
    """Measure studies of all sizes asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--methods", type=int, nargs="+", default=[14, 100], help="top-level runs of each study")
    parser.add_argument("--runs", type=int, nargs="+", default=[5, 5], help="children of each of them, study by study")
    parser.add_argument("--pictures", type=Path, help="folder for screenshots")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["MLFLOW_TRACKING_URI"] = f"sqlite:///{folder}/mlflow.db"
        open_store()
        with serving() as address, sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
            for number, runs in zip(options.methods, options.runs, strict=True):
                begin = time.perf_counter()
                assert log_runs(Study(f"synthetic {number}", "0" * 64), synthetic_runs(number, runs), "")
                print(f"{number} methods with {runs} runs each: logged in {time.perf_counter() - begin:.1f} s")
                measure(browser.new_page(viewport={"width": 1500, "height": 1250}), address, number, options.pictures)
            browser.close()


def synthetic_runs(n_methods: int, n_runs: int) -> list[RunLog]:
    """Runs with drawn scores, of which one has another setting."""
    rng, settings = np.random.default_rng(0), flat(dataclasses.asdict(Settings()))
    logs = []
    for number in range(n_methods):
        name, level = f"synthetic-{number:02d}", rng.uniform(0.25, 0.95)
        params = {"method": name, "world": "bench", "perception": "truth", "seed": 100, "split": "paper", **settings}
        if number == 1:
            params["search.max_rounds"] = 2 * params["search.max_rounds"]
        children = tuple(
            RunLog(f"{name}: run {run}", {"n": number, "run": run}, metrics=drawn(rng, level), tags={KIND: RUN})
            for run in range(n_runs)
        )
        identity = {"n": number, "of": n_methods}
        logs.append(RunLog(name, identity, params, drawn(rng, level), tags={KIND: METHOD}, children=children))
    return logs


def drawn(rng: np.random.Generator, level: float) -> dict[str, float]:
    """Every metric of a run."""
    names = [(part, goals) for part in (*SCORES, *SCATTER, *COUNTS) for goals in GOALS]
    return {
        metric(part, goals, setup): float(np.clip(level + rng.normal(0, 0.05), 0, 1))
        for part, goals in names
        for setup in (*SETUPS, "all", MEAN)
    }


@contextlib.contextmanager
def serving() -> Iterator[str]:
    """The page that `cutgrammar mlflow` starts, until the context ends."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "cutgrammar_pipelines", "mlflow", "--port", str(port), "--no-browser"]
    begin, server = time.perf_counter(), subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        while True:
            with contextlib.suppress(OSError), urllib.request.urlopen(f"http://127.0.0.1:{port}/health", timeout=60):
                break
            time.sleep(0.2)
        print(f"the server answers after {time.perf_counter() - begin:.1f} s")
        yield f"http://127.0.0.1:{port}"
    finally:
        server.send_signal(signal.SIGTERM)
        server.wait()


def measure(page: Page, address: str, number: int, pictures: Path | None) -> None:
    """Open both pages of one study and print the times."""
    client = open_store().client
    experiment = client.get_experiment_by_name(f"synthetic {number}").experiment_id
    begin = time.perf_counter()
    page.goto(f"{address}{link(experiment)}")
    page.locator(".barlayer .point").first.wait_for(timeout=LONGEST)
    print(f"{number} methods, chart page: first bars after {time.perf_counter() - begin:.1f} s")
    methods = client.search_runs(
        [experiment], f"tags.{KIND} = '{METHOD}'", max_results=5, order_by=["attributes.run_name"]
    )
    chosen = json.dumps([run.info.run_id for run in methods])
    save(page, pictures, f"mlflow_chart_{number}")
    begin = time.perf_counter()
    page.goto(f'{address}/#/compare-runs?runs={chosen}&experiments=["{experiment}"]')
    page.get_by_text("search.max_rounds").first.wait_for(timeout=LONGEST)
    print(f"{number} methods, compare page of five: settings after {time.perf_counter() - begin:.1f} s")
    save(page, pictures, f"mlflow_compare_{number}")


def save(page: Page, pictures: Path | None, name: str) -> None:
    """Save a screenshot, if wanted, when the page rests."""
    if pictures is not None:
        page.wait_for_timeout(8000)
        pictures.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=pictures / f"{name}.png")


if __name__ == "__main__":
    main()
