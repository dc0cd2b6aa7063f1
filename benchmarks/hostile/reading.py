"""Reads a stranger's files as the commands do, without their work: many inputs a second, in one process for a batch.

What a reader says to a hostile file is an `InputError` of one line; anything else is a fault of the reader.
"""

import io
import json
import os
import select
import shutil
import signal
import stat
import tempfile
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

from cutgrammar.errors import InputError
from cutgrammar.learning.model import load_model
from cutgrammar.settings.files import load_settings
from cutgrammar.storage.data_set import DataSet
from cutgrammar.storage.ledger import (
    Ledger,
    count_missing,
    read_attempts,
    read_known_configurations,
    read_planned,
    read_records,
    read_statuses,
)
from cutgrammar.storage.part_footers import trust_footer
from cutgrammar.storage.ratings import read_ratings
from cutgrammar.storage.run_folder import ledger_of, read_run
from cutgrammar.storage.split import read_split
from cutgrammar.trials.trajectory import trajectory_from_json
from cutgrammar.untrusted import read_regular
from cutgrammar.untrusted.parser_processes import time_of_parsers
from cutgrammar.untrusted.printing import one_line
from cutgrammar_dashboards.demonstrating.journal import read_journal
from cutgrammar_dashboards.demonstrating.journal_schema import check_entry
from cutgrammar_dashboards.recording.comparison import write_side_by_side
from cutgrammar_dashboards.recording.viewer import merge
from cutgrammar_pipelines.config import ImportConfig, StudyConfig
from cutgrammar_pipelines.stages.import_recorded import import_recorded
from cutgrammar_pipelines.study.study_file import load_study
from cutgrammar_sim.arm.robot.urdf import read_urdf
from hostile.cases import Case
from hostile.good import RECORDED, RECORDINGS, trust_good_parts
from hostile.mutations import counts, mutated
from hostile.page_requests import Pages
from hostile.running import CONTROL, LONGEST_LINE, SECONDS, WAIT, limit_memory

Finding = tuple[str | None, bool, float]
"""What is wrong with a reader, or None; whether it accepted the input; and how long it took [s]."""
MAX_FILE = 10_000_000
BATCH = 100
"""Inputs that one process reads."""


def _tables(folder: Path) -> None:
    data = DataSet.open(folder / "data")
    for trial in data.trials:
        data.demonstration(trial.trial)


def _split(folder: Path) -> None:
    read_split(DataSet.open(folder / "data"), "share")


def _ledger(folder: Path) -> None:
    ledger = ledger_of(folder / "run")
    planned = read_planned(ledger)
    read_attempts(ledger)
    read_records(ledger, events=False)
    keys = [record.key for record in read_records(ledger)]
    read_known_configurations(ledger, [*planned, *keys])


def _attempts(folder: Path) -> None:
    """What a report and a resume read of attempts."""
    file = ledger_of(folder / "run")
    read_attempts(file)
    read_statuses(file)
    count_missing(file)
    with Ledger(file) as ledger:
        ledger.keys(("crashed", "failed"))
        ledger.attempts()


def _journal(folder: Path) -> None:
    for number, entry in enumerate(read_journal(folder / "open.journal"), 1):
        try:
            check_entry(entry, is_first=number == 1)
        except ValueError as error:
            raise InputError(f"open.journal, line {number}: {error}") from None


def _study(folder: Path) -> None:
    load_study(StudyConfig(out=folder / "study", settings=folder / "study.toml"))


def _urdf(folder: Path) -> None:
    try:
        text = read_regular(folder / "arm.urdf", MAX_FILE).decode()
    except UnicodeDecodeError as error:
        raise InputError(f"arm.urdf: {error}") from None
    read_urdf(text, "flange")


def _trajectory(folder: Path) -> None:
    trajectory_from_json(read_regular(folder / "trajectory.json", MAX_FILE), "trajectory.json")


def _recording(folder: Path) -> None:
    kept = sorted((folder / "run" / "recordings").glob("*"))
    files = {str(number): file for number, file in enumerate(kept or [folder / file for file in RECORDINGS.values()])}
    with tempfile.TemporaryDirectory() as out:
        write_side_by_side(files, "a trial", Path(out, "both.rrd"))
        merge(list(files.values()), Path(out, "merged.rrd"))


def _import(folder: Path) -> None:
    with tempfile.TemporaryDirectory() as out, redirect_stderr(io.StringIO()) as told, redirect_stdout(told):
        import_recorded(ImportConfig(folder / RECORDED, out=Path(out, "data")))
    if found := CONTROL.search(told.getvalue()):
        raise ValueError(f"prints the control character {found.group()!r}")


READERS: dict[str, Callable[[Path], Any]] = {
    "manifest": lambda folder: DataSet.open(folder / "data"),
    "tables": _tables,
    "split": _split,
    "model": lambda folder: load_model(folder / "model"),
    "tensors": lambda folder: load_model(folder / "model"),
    "grammar": lambda folder: load_model(folder / "model"),
    "run": lambda folder: read_run(folder / "run"),
    "ledger": _ledger,
    "ratings": lambda folder: read_ratings(folder / "run"),
    "settings": lambda folder: load_settings(folder / "settings.toml"),
    "study": _study,
    "urdf": _urdf,
    "journal": _journal,
    "trajectory": _trajectory,
    "attempts": _attempts,
    "recording": _recording,
    "import": _import,
}
"""What reads the files of a stranger's folder, by the name of the reader."""
PAGES = ("demonstration page", "rating page")


def problems_of_random(total: int, seed: int, good: Path, place: Path) -> list[str]:
    """Read about `total` random inputs of all readers and pages, as `read_all` does; what is wrong, a line each."""
    each = counts(total, [*READERS, *PAGES]).items()
    cases = [mutated(seed, number, reader) for reader, count in each for number in range(count)]
    findings = read_all(cases, good, place)
    return [f"{case.reader}: {case.name}: {f[0]}" for case, f in zip(cases, findings, strict=True) if f[0]]


def read_all(cases: Sequence[Case], good: Path, place: Path) -> list[Finding]:
    """Read hostile inputs in forks of this process, `BATCH` at a time.

    Args:
        cases: the inputs.
        good: folder of good files.
        place: an empty folder, in which each process works.

    Returns:
        A finding for each input.
    """
    found: list[Finding] = []
    while len(found) < len(cases):
        batch = cases[len(found) : len(found) + BATCH]
        lines, status = _in_a_fork(batch, good, place)
        found += lines
        if len(lines) < len(batch):  # the next one ended the process
            problem = f"hangs: not done after {SECONDS:.0f} s" if status is None else f"dies with status {status}"
            found.append((problem, False, SECONDS if status is None else 0.0))
    return found


def _in_a_fork(cases: Sequence[Case], good: Path, place: Path) -> tuple[list[Finding], int | None]:
    """The results of a process, and its status; None if it was killed because it did not go on."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        os.setsid()
        try:
            with os.fdopen(writer, "w", buffering=1) as out:
                limit_memory()
                _work(cases, good, place, lambda result: print(json.dumps(result), file=out))
        finally:
            os._exit(0)
    os.close(writer)
    content, heard, computed, status = b"", time.monotonic(), _computed(child), None
    while True:
        if select.select([reader], [], [], 0.5)[0]:
            part = os.read(reader, 1 << 16)
            if not part:
                _, status = os.waitpid(child, 0)
                break
            content, heard, computed = content + part, time.monotonic(), _computed(child)
        elif _computed(child) - computed > 2 * SECONDS or time.monotonic() - heard > 5 * WAIT:  # it makes inputs, too
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            break
    os.close(reader)
    return [tuple(json.loads(line)) for line in content.splitlines()], status


def _computed(process: int) -> float:
    """Time for which a process has computed [s]; the machine may be too busy to go by the clock."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _work(cases: Sequence[Case], good: Path, place: Path, tell: Callable[[Any], None]) -> None:
    folder = place / "stranger"
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(good, folder)
    trust_good_parts(folder, good)
    pages: Pages | None = None
    for case in cases:
        began = _used()
        if case.reader in PAGES:
            pages = pages or Pages(place / "pages")
            problem, accepted = _problem(lambda case=case, pages=pages: case.spoil(pages))
        else:
            case.spoil(folder)
            before = _names(place)
            began = _used()
            problem, accepted = _problem(lambda case=case: READERS[case.reader](folder))
            if (after := _names(place)) != before:
                problem = f"writes {', '.join(sorted(after ^ before))[:200]}"
        seconds = _used() - began
        if seconds > SECONDS:
            problem = problem or f"takes {seconds:.0f} s"
        if case.reader not in PAGES:
            _restore(folder, good)
        tell((problem, accepted, seconds))


def _used() -> float:
    """Processor time of this process, of those that it has waited for and of parsers [s]."""
    return sum(os.times()[:4]) + time_of_parsers()


def _problem(read: Callable[[], Any]) -> tuple[str | None, bool]:
    """What is wrong with a reader, or None, and whether it accepted the input."""
    try:
        told = read()
    except InputError as error:
        message = one_line(str(error))  # as the command line prints it
        if len(message) > LONGEST_LINE:
            return f"tells {len(message)} characters", False
        found = CONTROL.search(message)
        return (f"tells the control character {found.group()!r}" if found else None), False
    except BaseException:  # noqa: BLE001  (whatever it is, it is a finding)
        return f"traceback: {traceback.format_exc().strip().splitlines()[-1][:300]}", False
    return (told, False) if isinstance(told, str) else (None, told is not False)


def _names(place: Path) -> set[str]:
    return {str(path.relative_to(place)) for path in place.rglob("*")}


def _restore(folder: Path, good: Path) -> None:
    """Make the files of a folder the good ones again; most of them are unchanged, which their times and sizes tell."""
    found, wanted = _facts(folder), _facts(good)
    for name in found.keys() - wanted.keys():
        path = folder / name
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    for name in sorted(wanted):  # folders before what is in them
        if found.get(name) == wanted[name]:
            continue
        if wanted[name] is None:
            (folder / name).mkdir()
        else:
            (folder / name).unlink(missing_ok=True)
            shutil.copy2(good / name, folder / name)
            if name.endswith(".parquet"):
                trust_footer(folder / name)


def _facts(folder: Path) -> dict[str, tuple[int, int] | None]:
    """Path -> size and time of its last change; None for folders."""
    facts = {}
    for path in folder.rglob("*"):
        found = path.lstat()
        is_folder = stat.S_ISDIR(found.st_mode)
        facts[str(path.relative_to(folder))] = None if is_folder else (found.st_size, found.st_mtime_ns)
    return facts
