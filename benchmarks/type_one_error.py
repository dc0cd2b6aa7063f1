"""How often tests of two equal methods call them different, when a few models and many trials are a sample of both.

Differences are drawn with a part of the trial, a part of the model and a rest, all normal with mean 0, for trials in
the six setups of Table I (24 and five times 14) or in one of them. Compared at the 5 % level: the test of reports
(`cutgrammar.results.crossed`), the percentile bootstrap that resamples trials within setups and models, and the t test
over trials alone, averaged over models.

Run: python benchmarks/type_one_error.py [--draws 2000]
"""

import argparse

import numpy as np
from scipy import stats

from cutgrammar.results.crossed import Crossing, crossed_mean

TRIALS, REST = 0.12, 0.08
"""Standard deviations between trials and of the rest, about those of strict IoU differences between learned methods."""
MODELS = (0.0, 0.01, 0.02, 0.05)
"""Standard deviations between models."""
SIZES = ((24, 14, 14, 14, 14, 14), (14,))
RESAMPLES = 1000


def rejections(
    sizes: tuple[int, ...], n_models: int, data_sets: int, models: float, rest: float, draws: int
) -> list[float]:
    """Share of draws in which each of the three tests rejects equality at 5 %."""
    rng, setups = np.random.default_rng(0), np.repeat(np.arange(len(sizes)), sizes)
    counts = np.zeros(3)
    for _ in range(draws):
        values = [
            rng.normal(0, TRIALS, (len(setups), 1))
            + rng.normal(0, models, n_models)
            + rng.normal(0, rest, (len(setups), n_models))
            for _ in range(data_sets)
        ]
        found = crossed_mean([Crossing(x, setups) for x in values])
        assert found is not None
        alone = stats.ttest_1samp(np.concatenate([x.mean(axis=1) for x in values]), 0.0).pvalue
        counts += [found.p_value() < 0.05, _bootstrap_rejects(values, setups, rng), alone < 0.05]
    return list(counts / draws)


def _bootstrap_rejects(values: list[np.ndarray], setups: np.ndarray, rng: np.random.Generator) -> bool:
    """Whether 0 is outside the percentile interval of resampled trials, within setups, and models."""
    means = np.zeros(RESAMPLES)
    for x in values:
        weights = np.zeros((RESAMPLES, len(x)))
        for setup in np.unique(setups):
            (chosen,) = np.nonzero(setups == setup)
            weights[:, chosen] = rng.multinomial(len(chosen), np.full(len(chosen), 1 / len(chosen)), size=RESAMPLES)
        m = x.shape[1]
        models = rng.multinomial(m, np.full(m, 1 / m), size=RESAMPLES)
        means += ((weights @ x) * models).sum(axis=1) / (len(x) * m * len(values))
    low, high = np.quantile(means, [0.025, 0.975])
    return bool(low > 0.0 or high < 0.0)


def main() -> None:
    """Print the shares for every combination."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=2000)
    draws = parser.parse_args().draws
    print("trials  models  data sets  std of models  rest   crossed  bootstrap  trials alone")
    for sizes in SIZES:
        for n_models, data_sets in ((5, 1), (5, 3)):
            for models, rest in ((0.0, 0.0), *((std, REST) for std in MODELS)):
                crossed, bootstrap, alone = rejections(sizes, n_models, data_sets, models, rest, draws)
                print(
                    f"{sum(sizes):6}  {n_models:6}  {data_sets:9}  {models:13.2f}  {rest:4.2f}   {crossed:7.3f}  "
                    f"{bootstrap:9.3f}  {alone:12.3f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
