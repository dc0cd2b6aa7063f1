"""The demonstrations that people make together: who does which task, and the data set that their work becomes.

Each task is done once. The folder of the data set also has `sessions/`, with the journal of every task that was begun.
A finished demonstration is on disk in its journal before it is added to the data set, so whatever happens in between,
opening the collection again completes the data set.

A task whose participant does nothing for `ABANDONED_SECONDS`, or for `UNTOUCHED_SECONDS` before the first cut, is given
to somebody else, but only when no other task is left. Until then its participant may continue. The journal of the
abandoned work stays beside the others.
"""

import os
import secrets
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from cutgrammar.atomic_files import sync_folder
from cutgrammar.storage.growing import add_trial, trials_in
from cutgrammar.storage.manifest import Manifest
from cutgrammar_dashboards.demonstrating.session import Session, read_actions
from cutgrammar_dashboards.demonstrating.task import Task
from cutgrammar_dashboards.pages.refusal import RefusedError

SESSIONS = "sessions"
"""The folder of the journals, within the data set."""


ABANDONED_SECONDS = 3600.0
"""Time without any request after which an open task may be given to somebody else [s]."""
UNTOUCHED_SECONDS = 600.0
"""The same for a task in which nothing was cut yet: whoever only opens the page cannot keep all tasks for long [s]."""


class Collection:
    """Hands out tasks and keeps the work; several threads may use it."""

    def __init__(
        self,
        folder: Path,
        trials: Sequence[int],
        make_task: Callable[[int], Task],
        facts: Manifest,
        clock: Callable[[], float] = time.time,
    ) -> None:
        """Open or create the collection in an existing folder.

        Args:
            folder: of the data set.
            trials: the trials to be demonstrated, in the order in which they are handed out.
            make_task: makes the task of a trial, always the same.
            facts: how the data set is made.
            clock: tells the time [s, Unix].

        Raises:
            InputError: what the folder holds belongs to other tasks.
        """
        self._folder, self._trials, self._make_task, self._facts = folder, tuple(trials), make_task, facts
        self._clock = clock
        self._lock = threading.Lock()
        self._by_key: dict[str, Session] = {}
        self._key_of: dict[str, str] = {}  # participant -> the key that counts
        self._open: dict[str, Session] = {}  # participant -> their open demonstration
        (folder / SESSIONS).mkdir(exist_ok=True)
        self._saved = set(trials_in(folder))
        self._begun = set(self._saved)
        for trial in self._trials:
            self._reopen(trial)

    @property
    def progress(self) -> tuple[int, int]:
        """Number of tasks that are saved, and of all."""
        return len(self._saved), len(self._trials)

    def join(self, participant: str, by_robot: bool) -> tuple[str, Session | None]:
        """Give a participant their open demonstration, or the next task; None if no task is left.

        Returns:
            The key that the participant's further requests must show, and the session. Older keys become invalid.

        Raises:
            OSError: the disk is full.
        """
        with self._lock:
            session = self._open.get(participant)
            if session is None and (trial := self._next()) is not None:
                task = self._make_task(trial)
                session = Session(self._path(trial), task, participant, by_robot)
                self._begun.add(trial)
                self._open[participant] = session
            self._by_key.pop(self._key_of.pop(participant, ""), None)
            key = secrets.token_urlsafe(18)
            if session is not None:
                session.last_seen = self._clock()
                self._by_key[key] = session
                self._key_of[participant] = key
            return key, session

    def session(self, key: str) -> Session:
        """The session of a key.

        Raises:
            RefusedError: the key is unknown, the participant has continued elsewhere, or somebody else has the task.
        """
        session = self._by_key.get(key)
        if session is None:
            raise RefusedError(403, "this page is no longer connected to your work; enter your code to continue")
        session.check_not_released()
        session.last_seen = self._clock()
        return session

    def save(self, session: Session, after: int, seconds: float, by_robot: bool) -> None:
        """Finish a demonstration and add it to the data set; when this returns, both are on disk.

        Raises:
            RefusedError: see `Session.finish`.
            OSError: the disk is full; saving again continues.
        """
        trial = session.state.task.trial
        if trial in self._saved or not session.is_saved:
            session.finish(after, seconds, by_robot)
        with self._lock:
            self._add(trial, session)
            if self._open.get(session.participant) is session:
                del self._open[session.participant]

    def _add(self, trial: int, session: Session) -> None:
        add_trial(self._folder, session.state.demonstration(session.demonstrator), self._facts)
        self._saved.add(trial)

    def _next(self) -> int | None:
        """A task that nobody has begun, otherwise one that was abandoned, otherwise None."""
        fresh = next((trial for trial in self._trials if trial not in self._begun), None)
        return self._release() if fresh is None else fresh

    def _release(self) -> int | None:
        """Take the task that may be given away for longest from its participant."""

        def kept_until(session: Session) -> float:
            return session.last_seen + (ABANDONED_SECONDS if session.is_touched else UNTOUCHED_SECONDS)

        for session in sorted(self._open.values(), key=kept_until):
            if kept_until(session) > self._clock():
                break
            if not session.lock.acquire(blocking=False):  # someone acts on it now; waiting here could wait for ever
                continue
            try:
                if session.is_saved:  # only the data set lacks it, e.g. because the disk was full
                    continue
                trial = session.state.task.trial
                os.replace(self._path(trial), self._path_of_abandoned(trial))
                sync_folder(self._folder / SESSIONS)
                session.is_released = True
                del self._open[session.participant]
            finally:
                session.lock.release()
            return trial
        return None

    def _path_of_abandoned(self, trial: int) -> Path:
        number = 1
        while (path := self._folder / SESSIONS / f"trial-{trial:05d}-abandoned-{number}.jsonl").exists():
            number += 1
        return path

    def _path(self, trial: int) -> Path:
        return self._folder / SESSIONS / f"trial-{trial:05d}.jsonl"

    def _reopen(self, trial: int) -> None:
        """Take up what the journal of a trial holds."""
        if trial in self._saved or not (entries := read_actions(self._path(trial))):
            return
        session = Session(self._path(trial), self._make_task(trial), entries[0]["participant"], False)
        self._begun.add(trial)
        if session.is_saved:
            self._add(trial, session)
        else:
            self._open[session.participant] = session
