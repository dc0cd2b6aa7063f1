"""One demonstration in the hands of one participant: every action is on disk before it counts."""

import hashlib
import threading
import time
from pathlib import Path
from typing import Any

from cutgrammar.demonstration import PERSON, ROBOT, HandStroke
from cutgrammar.errors import InputError
from cutgrammar.geometry.plane import Plane
from cutgrammar.geometry.slicing import Missed
from cutgrammar_dashboards.demonstrating.cutting_state import CuttingState, new_state
from cutgrammar_dashboards.demonstrating.journal import Journal, read_journal
from cutgrammar_dashboards.demonstrating.journal_schema import check_entry
from cutgrammar_dashboards.demonstrating.strokes import target_of
from cutgrammar_dashboards.demonstrating.task import Task
from cutgrammar_dashboards.pages.refusal import RefusedError


class Session:
    """A demonstration that is being made; its journal can be read again after any interruption.

    Attributes:
        participant: code of who makes it.
        lock: to be held by who reads or changes the session.
        state: what has been done.
        actions: number of entries of the journal.
        seconds: time of the last action since the task was shown first [s].
        by_robot: whether any of its actions came from a test robot.
        is_touched: whether anything was cut in it, be it undone since.
        is_saved: whether it is finished.
        last_seen: time of the last request about it, or of its last action before the server was started [s, Unix].
        is_released: whether its task was given to somebody else; nothing more may be done here.
    """

    def __init__(self, path: Path, task: Task, participant: str, by_robot: bool) -> None:
        entries = read_actions(path)
        self.lock = threading.Lock()
        self._journal = Journal(path)
        self.state = new_state(task)
        self.participant, self.actions, self.seconds, self.by_robot, self.is_saved = participant, 0, 0.0, False, False
        self.is_touched = False
        self.last_seen = path.stat().st_mtime if entries else time.time()
        self.is_released = False
        for number, entry in enumerate(entries, start=1):
            try:
                self._apply(entry)
            except (ValueError, IndexError) as error:
                if isinstance(error, InputError):
                    raise
                raise InputError(f"{path}, line {number}: {error}; move the file away") from None
        if not entries:
            self._do({"do": "start", "participant": participant, "robot": by_robot, "start": digest_of(task)})
        elif by_robot and not self.by_robot:
            self._do({"do": "resume", "robot": True})

    @property
    def demonstrator(self) -> str:
        """Who made it, as the data set says it."""
        return f"{ROBOT if self.by_robot else PERSON} {self.participant}"

    def cut(self, after: int, stroke: HandStroke, by_robot: bool) -> tuple[int, tuple[int, ...]]:
        """Make a cut; return the fragment cut and its products.

        Args:
            after: number of actions that the participant has seen; another number means a repeated or lost request.
            stroke: how it is made.
            by_robot: whether a test robot makes it.

        Raises:
            RefusedError: the request is out of date, or the stroke cuts nothing.
            OSError: it cannot be kept; nothing has changed.
        """
        self._check(after)
        target = target_of(self.state, stroke)
        if isinstance(target, Missed):
            raise RefusedError(422, target.reason)
        fragment, plane_W = target
        if isinstance(cut := self.state.cut(fragment, plane_W, stroke), Missed):
            raise RefusedError(422, cut.reason)
        facts = {
            "do": "cut",
            "fragment": fragment,
            "plane_W": plane_W.to_vector().tolist(),
            "stroke": stroke_facts(stroke),
            "robot": by_robot,
            "seconds": stroke.cut_seconds,
        }
        self._do(facts, cut)
        return fragment, self.state.cuts[-1].products

    def undo(self, after: int, seconds: float, by_robot: bool) -> None:
        """Undo the last cut that still stands.

        Raises:
            RefusedError: the request is out of date, or there is no cut to undo.
            OSError: it cannot be kept; nothing has changed.
        """
        self._check(after)
        if not self.state.made:
            raise RefusedError(422, "there is no cut to undo")
        self._do({"do": "undo", "robot": by_robot, "seconds": seconds})

    def finish(self, after: int, seconds: float, by_robot: bool) -> None:
        """Mark the demonstration as finished.

        Raises:
            RefusedError: the request is out of date, or an object is still whole.
            OSError: it cannot be kept; nothing has changed.
        """
        self._check(after)
        if whole := self.state.unfinished():
            raise RefusedError(422, f"Still whole: {', '.join(whole)}; cut every object before you save")
        self._do({"do": "save", "robot": by_robot, "seconds": seconds})

    def check_not_released(self) -> None:
        """Refuse everything once the task was given to somebody else.

        Raises:
            RefusedError: it was.
        """
        if self.is_released:
            raise RefusedError(
                403,
                "nothing was done here for long, so this task was given to somebody else; your cuts are kept, and "
                "your code brings you to another task",
            )

    def _check(self, after: int) -> None:
        self.check_not_released()
        if self.is_saved:
            raise RefusedError(409, "this demonstration is saved already")
        if after != self.actions:
            raise RefusedError(409, "this page is out of date; it is loaded again")

    def _do(self, entry: dict[str, Any], state: CuttingState | None = None) -> None:
        self._journal.append(entry)
        self._apply(entry, state)

    def _apply(self, entry: dict[str, Any], state: CuttingState | None = None) -> None:
        """Carry out an entry of the journal; `state` is what a cut makes, if that is known."""
        kind = entry["do"]
        if kind == "start":
            if entry["start"] != digest_of(self.state.task):
                raise InputError(
                    f"trial {self.state.task.trial} was begun with other objects than this version or request makes; "
                    "choose another --out"
                )
            self.participant = entry["participant"]
        elif kind == "cut":
            if state is None:
                plane = Plane(entry["plane_W"][:3], entry["plane_W"][3])
                made = self.state.cut(entry["fragment"], plane, HandStroke(step=0, **entry["stroke"]))
                if isinstance(made, Missed):
                    raise InputError(f"trial {self.state.task.trial}: a cut of its journal cannot be repeated")
                state = made
            self.state, self.is_touched = state, True
        elif kind == "undo":
            self.state = self.state.undo(entry["seconds"])
        elif kind == "save":
            self.is_saved = True
        self.actions += 1
        self.seconds = max(self.seconds, float(entry.get("seconds", 0.0)))
        self.by_robot = self.by_robot or bool(entry["robot"])


def read_actions(path: Path) -> list[dict[str, Any]]:
    """The actions that a journal holds; none if there is no such file.

    Raises:
        InputError: it is no ordinary file, or a line is no action.
    """
    entries = read_journal(path)
    for number, entry in enumerate(entries, start=1):
        try:
            check_entry(entry, is_first=number == 1)
        except ValueError as error:
            raise InputError(f"{path}, line {number}: {error}; move the file away") from None
    return entries


def stroke_facts(stroke: HandStroke) -> dict[str, Any]:
    """A stroke as JSON, without its step and whether it was undone."""
    return {
        "p_WE": stroke.p_WE.tolist(),
        "first_W": stroke.first_W.tolist(),
        "second_W": stroke.second_W.tolist(),
        "explode": stroke.explode,
        "first_seconds": stroke.first_seconds,
        "second_seconds": stroke.second_seconds,
        "cut_seconds": stroke.cut_seconds,
    }


def digest_of(task: Task) -> str:
    """sha256 of the objects of a task and their places."""
    digest = hashlib.sha256()
    for whole in task.start:
        for array in (whole.mesh.vertices, whole.mesh.faces, whole.X_WF.to_vector()):
            digest.update(array.tobytes())
    return digest.hexdigest()
