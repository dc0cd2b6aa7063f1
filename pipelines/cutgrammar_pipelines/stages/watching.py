"""`--watch`: what a run does is shown in a viewer while it does it, which never changes or stops the run."""

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path

from cutgrammar.storage.ledger import read_records
from cutgrammar.storage.run_folder import ledger_of
from cutgrammar.trials.news import Outlet, RunBegan, TrialSaved
from cutgrammar.trials.record import Record, TrialKey
from cutgrammar_pipelines.config import EvaluateConfig
from cutgrammar_pipelines.stages.progress import note
from cutgrammar_workers.pool import n_workers
from cutgrammar_workers.relays import MAX_ON_THEIR_WAY, relay

RELAY = "cutgrammar_dashboards.live.relay:Relay"


@contextlib.contextmanager
def watched(
    watch: tuple[str, ...] | None,
    workers: int | None,
    address: str | None = None,
    py_modules: Sequence[Path] = (),
    max_waiting: int = MAX_ON_THEIR_WAY,
) -> Iterator[Outlet | None]:
    """An outlet to the viewer for the length of a `with` block; None where nobody watches.

    Args:
        watch: see `WatchOption`.
        workers, address, py_modules: see `pool.run_all`.
        max_waiting: see `relay`.
    """
    if watch is None:
        yield None
        return
    if watch:
        url, told = watch[0], f"shown in the viewer at {watch[0]}"
    else:
        from cutgrammar_dashboards.recording.viewer import start_viewer  # rerun takes a second to import

        url, told = start_viewer()
    note(told)
    with relay(RELAY, (url, not watch), workers, address, py_modules, max_waiting) as outlet:
        yield outlet


def tell_beginning(outlet: Outlet | None, config: EvaluateConfig, keys: Sequence[TrialKey]) -> None:
    """Tell that an evaluation begins, with the scores that its ledger already holds."""
    if outlet is None:
        return
    wanted, scored = set(keys), dict[str, list[float]]()
    if ledger_of(config.out).exists():
        for record in read_records(ledger_of(config.out), events=False):
            if record.key in wanted:
                scored.setdefault(record.key.method, []).append(record.iou_strict)
    outlet(
        RunBegan(
            name=config.out.name,
            planned=len(keys),
            workers=max(1, n_workers(config.workers)),
            arm=config.world == "kinova",
            cameras=config.perception == "cameras",
            scored={method: tuple(values) for method, values in scored.items()},
        )
    )


def saved(record: Record) -> TrialSaved:
    """The news that a record is in the ledger."""
    return TrialSaved(record.key.name, record.key.method, record.status, record.iou_strict)
