"""Whether Student's t may stand for the bootstrap where a report has many trials of one model.

Scores are drawn from populations of known mean, for as many trials as reports begin to take Student's t at, in six
setups; some are as lopsided as scores get. Of the 95 % intervals of the mean by both methods it prints the share that
holds the true mean, and the width and processor time of those by t divided by those of the bootstrap.

Run: python benchmarks/many_trials.py [--draws 400]
"""

import argparse
import time
from collections.abc import Callable

import numpy as np

from cutgrammar.results.crossed import Crossing, crossed_mean
from cutgrammar.results.statistics import MAX_RESAMPLED, bootstrap_interval

SETUPS = 6
N = MAX_RESAMPLED // SETUPS + 1
"""Trials of a setup."""
POPULATIONS: dict[str, tuple[Callable[[np.random.Generator], np.ndarray], float]] = {
    "Beta(5, 5)": (lambda rng: rng.beta(5, 5, SETUPS * N), 0.5),
    "Beta(9, 1): most nearly right": (lambda rng: rng.beta(9, 1, SETUPS * N), 0.9),
    "Beta(8, 2), three tenths of them 0": (
        lambda rng: rng.beta(8, 2, SETUPS * N) * (rng.random(SETUPS * N) > 0.3),
        0.7 * 0.8,
    ),
    "1, one in twenty 0": (lambda rng: (rng.random(SETUPS * N) > 0.05).astype(float), 0.95),
    "0, one in fifty 1": (lambda rng: (rng.random(SETUPS * N) > 0.98).astype(float), 0.02),
}


def main() -> None:
    """Print a line for every population."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=400)
    draws = parser.parse_args().draws
    setups = np.repeat(np.arange(SETUPS), N)
    print(f"{len(setups)} trials; {'':34} bootstrap      t  width  time of t")
    for name, (draw, mean) in POPULATIONS.items():
        rng, holds, widths, seconds = np.random.default_rng(0), np.zeros(2), np.zeros(2), np.zeros(2)
        for _ in range(draws):
            values = draw(rng)
            began = time.process_time()
            resampled = bootstrap_interval(values, setups, rng)
            between = time.process_time()
            crossed = crossed_mean([Crossing(values[:, None], setups)], for_these_models=True)
            assert resampled is not None
            assert crossed is not None
            by_t = tuple(float(end) for end in crossed.interval())
            seconds += between - began, time.process_time() - between
            for way, (low, high) in enumerate((resampled, by_t)):
                holds[way] += low <= mean <= high
                widths[way] += high - low
        shares, width, cost = holds / draws, widths[1] / widths[0], seconds[1] / seconds[0]
        print(f"{name:46} {shares[0]:9.3f}  {shares[1]:5.3f}  {width:5.3f}  {cost:9.5f}", flush=True)


if __name__ == "__main__":
    main()
