"""The number k of fragment types that maximises Eq. (1) for several data sets, compared with both ends of the curve.

Encoder and grammar are trained on the training trials exactly as in `cutgrammar train --seed`, so with equal settings k
is that of the model. The output lists k, gamma, the objective at both ends of the curve, and by how many standard
errors each end is worse than the best k. An end is worse if its mean over restarts is lower by at least two standard
errors of the difference; a data set passes if both ends are. `--restarts` makes the standard errors more precise, but
with more restarts the best k may differ.

Example:
    python benchmarks/k_stability.py data other_data --seeds 0 1 --restarts 4 --json curves.json
"""

import argparse
import dataclasses
import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cutgrammar.errors import InputError
from cutgrammar.grammar.corpus import Corpus
from cutgrammar.grammar.induction import CurvePoint, Induction, induce
from cutgrammar.learning.encoder_training import fit_features
from cutgrammar.learning.training_fragments import training_fragments
from cutgrammar.seeds import stream
from cutgrammar.settings import Settings, load_settings
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.split import read_split
from cutgrammar_pipelines.stages.progress import progress

MIN_STANDARD_ERRORS = 2.0
"""Number of standard errors by which an end must be worse."""


@dataclass(frozen=True)
class End:
    """Comparison of one end of the curve with the best k.

    Attributes:
        k: k at this end.
        worse_by: mean objective at the best k minus that at this end [nats].
        standard_error: standard error of this difference over restarts [nats].
    """

    k: int
    worse_by: float
    standard_error: float

    @property
    def worse(self) -> bool:
        """Whether this end is worse by at least two standard errors."""
        return self.worse_by > 0.0 and self.worse_by >= MIN_STANDARD_ERRORS * self.standard_error

    @property
    def standard_errors(self) -> float:
        """Number of standard errors by which this end is worse."""
        if self.worse_by == 0.0:
            return 0.0
        return self.worse_by / self.standard_error if self.standard_error else math.copysign(math.inf, self.worse_by)


def induced(data: DataSet, split: str, seed: int, settings: Settings) -> Induction:
    """The result of induction when training on this data set with this seed."""
    fragments = training_fragments([data.demonstration(trial) for trial in read_split(data, split).train])
    name = f"{data.path.name}, seed {seed}"
    with progress(f"encoder, {name}", settings.features.epochs) as advance:
        features, _ = fit_features(fragments.meshes, settings.features, stream(seed, "encoder"), lambda *_: advance())
    z = np.array([features.flipped(mesh)[0] for mesh in fragments.meshes])
    corpus = Corpus(z, np.array(fragments.trials), tuple((cut, made) for cut, made, _ in fragments.cuts))
    done = 0
    with progress(f"induction, {name}", 1 + settings.induction.n_folds) as advance:

        def watch(now: int, of: int) -> None:
            nonlocal done
            rounds = now * (1 + settings.induction.n_folds) // of
            advance(rounds - done)
            done = rounds

        return induce(corpus, settings.induction, stream(seed, "induction"), watch)


def ends(induction: Induction, restarts: int) -> tuple[End, End]:
    """Compare both ends of the curve with the best k."""
    best = next(point for point in induction.curve if point.k == induction.k)

    def squared_error(point: CurvePoint) -> float:
        """Squared standard error of the mean over restarts; for a single type there is no randomness."""
        return point.objective_std**2 / max(restarts - 1, 1) if point.k > 1 else 0.0

    def end(point: CurvePoint) -> End:
        error = math.sqrt(squared_error(best) + squared_error(point)) if point is not best else 0.0
        return End(point.k, best.objective_mean - point.objective_mean, error)

    return end(induction.curve[0]), end(induction.curve[-1])


def main() -> int:
    """Train, compare and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, nargs="+")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], help="seeds of the training")
    parser.add_argument("--split", default="paper")
    parser.add_argument("--settings", type=Path)
    parser.add_argument("--restarts", type=int, help="restarts per k, instead of the settings' number")
    parser.add_argument("--json", type=Path, help="file for the curves")
    options = parser.parse_args()
    found = []
    try:
        settings = load_settings(options.settings)
        if options.restarts:
            more = dataclasses.replace(settings.induction, n_starts=options.restarts)
            settings = dataclasses.replace(settings, induction=more)
        restarts = settings.induction.n_starts
        if restarts < 2:
            raise InputError(f"induction.restarts = {restarts} gives no standard error; give --restarts 2 or more")
        for path in options.data:
            data = DataSet.open(path)
            for seed in options.seeds:
                induction = induced(data, options.split, seed, settings)
                found += [(data, seed, induction)]
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"{restarts} restarts per k; worse: mean objective lower by at least {MIN_STANDARD_ERRORS:g} standard errors")
    print("data set  data seed  seed    k   gamma   best mean at    first k worse by (s.e.)     last k worse by (s.e.)")
    rows, passed = [], True
    for data, seed, induction in found:
        first, last = ends(induction, restarts)
        passed = passed and first.worse and last.worse
        peak = max(induction.curve, key=lambda point: point.objective_mean).k
        columns = "   ".join(
            f"{end.k:3d}: {end.worse_by:8.1f} ({end.standard_errors:5.1f}) {'yes' if end.worse else 'NO ':3s}"
            for end in (first, last)
        )
        name = f"{data.path.name:10s} {data.seed!s:>8} {seed:5d}"
        print(f"{name} {induction.k:4d} {induction.gamma:7g} {peak:14d}    {columns}")
        rows.append(
            {
                "data": data.digest,
                "data_seed": data.seed,
                "seed": seed,
                "k": induction.k,
                "gamma": induction.gamma,
                "best_mean_at": peak,
                "ends": [dataclasses.asdict(end) | {"worse": end.worse} for end in (first, last)],
                "curve": [dataclasses.asdict(point) for point in induction.curve],
            }
        )
    ks = [induction.k for _, _, induction in found]
    print(f"k from {min(ks)} to {max(ks)}; both ends worse everywhere: {'yes' if passed else 'no'}")
    if options.json:
        facts = {"induction": dataclasses.asdict(settings.induction), "split": options.split, "found": rows}
        options.json.write_text(json.dumps(facts, indent=1) + "\n")
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
