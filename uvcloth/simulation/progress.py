"""Progress of a batch: the frames of all workers, and the expected end."""

from collections import Counter
from datetime import datetime, timedelta

from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn
from rich.text import Text

SPEED_SECONDS = 3600.0
"""Seconds of the past over which the speed is measured that predicts the end."""


class FramesBar:
    """Bar of the frames that are made, while the block lasts; total: of all sequences."""

    def __init__(self, total: int) -> None:
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            _ProgressText(),
            speed_estimate_period=SPEED_SECONDS,
        )
        self._bar = self._progress.add_task("simulating", total=total)
        self._reached: Counter[str] = Counter()

    def __enter__(self) -> "FramesBar":
        self._progress.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._progress.stop()

    @property
    def task(self) -> Task:
        """Counts and speed."""
        return self._progress.tasks[0]

    def report(self, name: str, made: int) -> None:
        """Take in the number of frames that a sequence has now.

        One more than before is a simulated frame. Any other number is where a process begins: kept frames
        need not be simulated, lost ones have to be simulated again.
        """
        more = made - self._reached[name]
        self._reached[name] = made
        if more == 1:
            self.advance(1)
            return
        self._progress.update(self._bar, total=(self.task.total or 0) - more)
        if more > 0:
            self.print(f"{name}: continues after frame {made}")

    def advance(self, frames: int) -> None:
        """Count frames as done."""
        self._progress.advance(self._bar, frames)

    def print(self, line: str) -> None:
        """Print a line above the bar."""
        self._progress.console.print(line, soft_wrap=True)

    def print_progress(self) -> None:
        """Print the progress where no bar is shown."""
        if not self._progress.console.is_terminal:
            print(progress_text(self.task, datetime.now()), flush=True)


def progress_text(task: Task, now: datetime) -> str:
    """Text with the speed of all workers together and the expected end; kept frames do not count."""
    if not task.speed or task.remaining is None:
        return "measuring"
    end = now + timedelta(seconds=task.remaining / task.speed)
    done = f"{task.completed:.0f} of {task.total:.0f} frames"
    return f"{done}, {task.speed:.2f} per second, done {end:%a %d %b %H:%M}"


class _ProgressText(ProgressColumn):
    """Column of `progress_text`, once a second."""

    max_refresh = 1.0

    def render(self, task: Task) -> Text:
        """Text for a task."""
        return Text(progress_text(task, datetime.now()))
