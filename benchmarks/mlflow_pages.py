"""How long MLflow's chart and compare pages of a study take to load, in a browser.

The scores are those of a run folder, or made up: then the runs of a study are drawn at random, with as many metrics,
settings and children as those of a real one, and their names say that they are synthetic. They are logged to a store in
a temporary folder, which is deleted at the end. The time is from the request to the bars of the six charts that fill
the window, and to the settings that differ; that of an experiment without runs, to the words that say so, is what
MLflow's page takes by itself.

Run: python benchmarks/mlflow_pages.py [--evaluation RUN] [--methods 100] [--runs 5] [--loads 5] [--pictures FOLDER]
"""

import argparse
import contextlib
import dataclasses
import json
import os
import shutil
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser, Page, sync_playwright

from cutgrammar.results.score_table import MEAN
from cutgrammar.settings import Settings
from cutgrammar.storage.run_folder import read_run
from cutgrammar.trials.setups import SETUPS
from cutgrammar_pipelines.reports.build import build_report
from cutgrammar_pipelines.tracking.chart_page import link
from cutgrammar_pipelines.tracking.evaluation_logs import metric
from cutgrammar_pipelines.tracking.mlflow_store import log_evaluation, log_runs, open_store
from cutgrammar_pipelines.tracking.run_log import KIND, METHOD, RUN, RunLog, Study, flat

GOALS = ("in-place", "scattered", "foreign")
SCORES = ("iou_strict", "iou", "iou_refined", "spectral", "agreement")
SCATTER = ("iou_strict_ci95_low", "iou_strict_ci95_high", "iou_strict_worst_run", *(f"{s}_std_runs" for s in SCORES))
COUNTS = ("cuts", "seconds", "failures", "stuck", "dead_ends")
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"]
LONGEST = 600_000
"""Longest time that a page may take [ms]."""
BARS = ":nth-match(.barlayer:has(.point), 6)"
SETTINGS = '[aria-label="Parameters - Show diff only"][aria-checked="true"]'
EMPTY = "text=All runs are hidden"
"""What a page shows when it is complete."""


def main() -> None:
    """Measure studies of all sizes asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--methods", type=int, nargs="+", default=[14, 100], help="top-level runs of each study")
    parser.add_argument("--runs", type=int, nargs="+", default=[5], help="children of each of them, study by study")
    parser.add_argument("--evaluation", type=Path, help="run folder whose scores are a study, too")
    parser.add_argument("--compare", type=int, default=5, help="number of runs on the compare page")
    parser.add_argument("--loads", type=int, default=5, help="loads of each page")
    parser.add_argument("--pictures", type=Path, help="folder for screenshots")
    options = parser.parse_args()
    if len(options.runs) == 1:
        options.runs *= len(options.methods)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["MLFLOW_TRACKING_URI"] = f"sqlite:///{folder}/mlflow.db"
        open_store()
        with serving() as address, sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
            assert log_runs(Study("empty", "0" * 64), [], "")
            measure(browser, address, "empty", options)
            if options.evaluation is not None:
                study = Study.around(options.evaluation, read_run(options.evaluation).data_digest)
                assert log_evaluation(options.evaluation, build_report([options.evaluation]), study=study)
                measure(browser, address, study.name, options)
            for number, runs in zip(options.methods, options.runs, strict=True):
                begin = time.perf_counter()
                study = Study(f"synthetic {number}", "0" * 64)
                assert log_runs(study, synthetic_runs(number, runs), "")
                print(f"{number} methods with {runs} runs each: logged in {time.perf_counter() - begin:.1f} s")
                measure(browser, address, study.name, options)
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


def measure(browser: Browser, address: str, study: str, options: argparse.Namespace) -> None:
    """Open both pages of one study, each in a browser that knows nothing yet, and print the medians of their times."""
    client = open_store().client
    experiment = client.get_experiment_by_name(study).experiment_id
    methods = client.search_runs(
        [experiment], f"tags.{KIND} = '{METHOD}'", max_results=options.compare, order_by=["attributes.run_name"]
    )
    name = study.replace(" ", "_")
    if not methods:
        timed(browser, f"{study}, chart page", f"{address}{link(experiment)}", EMPTY, options, "")
        return
    timed(browser, f"{study}, chart page", f"{address}{link(experiment)}", BARS, options, f"mlflow_chart_{name}")
    chosen = json.dumps([run.info.run_id for run in methods])
    compare = f'{address}/#/compare-runs?runs={chosen}&experiments=["{experiment}"]'
    what = f"{study}, compare page of {len(methods)}"
    timed(browser, what, compare, SETTINGS, options, f"mlflow_compare_{name}")


def timed(browser: Browser, what: str, url: str, drawn: str, options: argparse.Namespace, picture: str) -> None:
    """Load a page several times until `drawn` is there, and print the median."""
    times = []
    for number in range(options.loads):
        page = browser.new_page(viewport={"width": 1600, "height": 1200})
        begin = time.perf_counter()
        page.goto(url, timeout=LONGEST)
        page.locator(drawn).first.wait_for(timeout=LONGEST)
        times.append(time.perf_counter() - begin)
        if number == 0 and picture:
            save(page, options.pictures, picture)
        page.close()
    print(
        f"{what}: {statistics.median(times):.1f} s, median of {len(times)} loads "
        f"({min(times):.1f} to {max(times):.1f}); load of the machine {os.getloadavg()[0]:.1f}",
        flush=True,
    )


def save(page: Page, pictures: Path | None, name: str) -> None:
    """Save a screenshot, if wanted, when the page rests."""
    if pictures is not None:
        page.wait_for_timeout(8000)
        pictures.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=pictures / f"{name}.png")


if __name__ == "__main__":
    main()
