"""What operators ask of the laboratory: sent, waited for with Blender alive, brought into the scene."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from . import sending
from .laboratory import Laboratory, laboratory_of
from .preferences import python_of
from .selection import wearer_of

LOOKS = 0.2
"""Seconds from one look at the laboratory to the next."""


@dataclass(frozen=True)
class Errand:
    """A command that runs for an armature and garments in it.

    names: of the garments, in the laboratory. rest: (4, 4) of the armature to the world, as it was sent.
    result: the file that is written.
    """

    armature: Any
    garments: Sequence[Any]
    names: Sequence[str]
    rest: np.ndarray
    laboratory: Laboratory
    result: Path


def begin(context: Any, command: str, result: str, *options: str, moves: bool = False) -> Errand:
    """Send the character that is meant, and its garments, to a command of the laboratory.

    result: name of the file that it writes. moves: with the character's motion in the scene's frames. Raises
    ValueError in a sentence, and OSError.
    """
    armature, entries = wearer_of(context)
    laboratory = laboratory_of(python_of(context))
    path = laboratory.folder / result
    path.unlink(missing_ok=True)
    names, words = sending.send(context, armature, entries, laboratory.folder, moves)
    laboratory.begin([command, *words, *options, "--out", path])
    garments = [entry.part for entry in entries]
    place = np.array(armature.matrix_world, np.float64)
    return Errand(armature, garments, names, place, laboratory, path)


class LaboratoryOperator:
    """An operator that sends an errand and brings its result into the scene; Esc stops it.

    Whoever inherits defines `begin` and `finish`, which raise ValueError or OSError.
    """

    _timer: Any = None
    _errand: Any = None

    def begin(self, context: Any) -> Any:
        """Send the errand: what has a `laboratory`, or what is waited for and killed like one."""
        raise NotImplementedError

    def finish(self, context: Any, errand: Any) -> None:
        """Bring what came of it into the scene."""
        raise NotImplementedError

    def execute(self, context: Any) -> set[str]:
        """Send it, and wait for it."""
        try:
            errand = self.begin(context)
            errand.laboratory.is_done(wait=True)
            self.finish(context, errand)
        except (ValueError, OSError) as error:
            return self._refuse(error)
        return {"FINISHED"}

    def invoke(self, context: Any, _event: Any) -> set[str]:
        """Send it, and look at it from time to time."""
        try:
            self._errand = self.begin(context)
        except (ValueError, OSError) as error:
            return self._refuse(error)
        self._timer = context.window_manager.event_timer_add(LOOKS, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any) -> set[str]:
        """Show what the laboratory says, until it is done or stopped."""
        assert self._errand is not None
        if event.type == "ESC":
            self._errand.laboratory.kill()
            return self._end(context, {"CANCELLED"})
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            if not self._errand.laboratory.is_done():
                said = self._errand.laboratory.said or "at work"
                context.workspace.status_text_set(f"uvcloth: {said} (Esc stops)")
                return {"RUNNING_MODAL"}
            self.finish(context, self._errand)
        except (ValueError, OSError) as error:
            return self._end(context, self._refuse(error))
        return self._end(context, {"FINISHED"})

    def _end(self, context: Any, how: set[str]) -> set[str]:
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)
        return how

    def _refuse(self, error: Exception) -> set[str]:
        self.report({"ERROR"}, sentence_of(error))  # type: ignore[attr-defined]
        return {"CANCELLED"}


def sentence_of(error: Exception) -> str:
    """An error as a sentence: one of the system without its number."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return str(error)


def report_to(operator: bpy.types.Operator, lines: Sequence[str], warns: bool) -> None:
    """Say lines in one pop-up or in the status bar."""
    operator.report({"WARNING"} if warns else {"INFO"}, "; ".join(lines))
