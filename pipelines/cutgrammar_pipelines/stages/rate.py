"""Rate: people compare goals with results on a page, without knowing which method reached them (IV-B2)."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from cutgrammar.command_lines import command_line
from cutgrammar.errors import InputError, one_of
from cutgrammar.results.human_rating import judge
from cutgrammar.storage.configurations import TrialConfigurations
from cutgrammar.storage.ledger import keys_with_configurations, read_configurations, read_records
from cutgrammar.storage.ratings import Rating, RatingStore, ratings_of, read_ratings
from cutgrammar.storage.run_folder import ledger_of, read_run, refuse_test_robots
from cutgrammar.trials.rating_plan import Pair, number_of_checks, plan_of_rater
from cutgrammar.trials.record import Record, TrialKey
from cutgrammar_dashboards.pages.access import access_to
from cutgrammar_dashboards.pages.serving import bound_socket, serve
from cutgrammar_dashboards.rating.app import rating_page
from cutgrammar_dashboards.rating.panel import Panel
from cutgrammar_dashboards.rating.shown_pair import ShownPairs
from cutgrammar_pipelines.config import RateConfig
from cutgrammar_pipelines.stages.progress import note, status
from cutgrammar_pipelines.tracking.later_sync import LaterSync


@dataclass(frozen=True, eq=False)
class Pool:
    """The trials that can be rated.

    Attributes:
        records: of the trials.
        run_of: digest of a trial's key -> the folder of its run.
        hidden: number of trials whose configurations are not known.
    """

    records: tuple[Record, ...]
    run_of: dict[str, Path]
    hidden: int

    def configurations(self, key: TrialKey) -> TrialConfigurations:
        """The configurations of a trial of the pool."""
        found = read_configurations(ledger_of(self.run_of[key.digest]), key)
        assert found is not None, f"{key.name} was in the ledger when the pool was made"
        return found


def rate(config: RateConfig) -> int:
    """Serve the rating page until it is interrupted.

    Raises:
        InputError: a folder is no run, nothing can be rated, the ratings are torn or in use, or the address cannot be
            used.
    """
    pool = pool_of(config.runs, config.methods)
    listening = bound_socket(access_to(config.host, config.port, config.allowed_hosts).host, config.port)
    access = access_to(config.host, listening.getsockname()[1], config.allowed_hosts)
    with LaterSync(config.runs) as sync, open_panel(config, pool, sync.request) as panel:
        if pool.hidden:
            note(f"NOTE {pool.hidden} trials cannot be shown, since their ledger does not hold their fragments")
        pairs = min(config.pairs, len(pool.records))
        checks = 2 * number_of_checks(pairs)
        status(f"{len(pool.records)} results can be rated; each person is shown {pairs} and {checks} attention checks")
        before = len(_all_ratings(config.runs))
        try:
            serve(rating_page(panel, ShownPairs(pool.configurations)), access, listening)
        finally:
            _summarise(config.runs)
            if len(_all_ratings(config.runs)) > before:
                sync.request()
    return 0


def pool_of(runs: Sequence[Path], methods: Sequence[str] | None = None) -> Pool:
    """The trials of `runs` that can be rated.

    Args:
        runs: folders that `evaluate` made.
        methods: whose results are rated; all if None.

    Raises:
        InputError: a folder is no run or repeats what a test robot did, a method has no trial, or nothing can be shown.
    """
    records: list[Record] = []
    run_of: dict[str, Path] = {}
    hidden = 0
    for run in runs:
        refuse_test_robots({run: read_run(run)})
        known = keys_with_configurations(ledger_of(run))
        for record in read_records(ledger_of(run)):
            digest = record.key.digest
            if digest in run_of or (methods and record.key.method not in methods):
                continue
            if digest not in known:
                hidden += 1
                continue
            run_of[digest] = run
            records.append(record)
    found = sorted({record.key.method for record in records})
    if not found and not methods:
        raise InputError("no trial of these runs can be shown: their ledgers hold no fragments; evaluate again")
    for method in methods or ():
        one_of("method with results to rate", method, found)
    return Pool(tuple(records), run_of, hidden)


@contextmanager
def open_panel(config: RateConfig, pool: Pool, finished: Callable[[], None] = lambda: None) -> Iterator[Panel]:
    """The panel of raters, with the ratings of all its runs open for writing.

    Args:
        config: how many pairs, and the seed.
        pool: the trials.
        finished: called when a rater has answered their last pair.

    Raises:
        InputError: ratings are torn, foreign, or in use by another server.
    """
    stores: dict[Path, RatingStore] = {}
    try:
        for run in dict.fromkeys(pool.run_of.values()):
            stores[run] = RatingStore(ratings_of(run))
        keys = {record.key.digest: record.key for record in pool.records}
        yield Panel(
            {digest: stores[run] for digest, run in pool.run_of.items()},
            _answered_pairs(stores.values(), keys),
            lambda code: plan_of_rater(pool.records, code, config.pairs, config.seed),
            finished,
        )
    finally:
        for store in stores.values():
            store.close()


def _answered_pairs(stores: Iterable[RatingStore], keys: dict[str, TrialKey]) -> dict[str, Pair]:
    """Digest -> pair, of all pairs that have a rating."""
    pairs = {}
    for store in stores:
        for rating in store.all():
            if rating.trial in keys and (rating.other is None or rating.other in keys):
                pairs[rating.pair] = Pair(rating.kind, keys[rating.trial], keys[rating.other] if rating.other else None)
    return pairs


def _summarise(runs: Sequence[Path]) -> None:
    """Print who has rated how much, and who does not count."""
    verdicts = judge(_all_ratings(runs))
    for verdict in verdicts:
        why = f"does not count: {verdict.reason}" if verdict.reason else "counts"
        note(f"rater {verdict.rater}: {verdict.ratings} pairs, {verdict.checks} checks; {why}")
    if verdicts:
        note(f"to see the ratings: {command_line('report', *runs)}")


def _all_ratings(runs: Sequence[Path]) -> list[Rating]:
    return [rating for run in dict.fromkeys(runs) for rating in read_ratings(run)]
