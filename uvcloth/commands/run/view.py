"""Live views of rollouts in the browser."""

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from queue import SimpleQueue

from rich.console import Console

from uvcloth.bodies.body import Body
from uvcloth.commands.view import View
from uvcloth.geometry.mesh import Mesh
from uvcloth.process.threads import limited_threads
from uvcloth.rollouts.rollout import RolloutFrame
from uvcloth.view.choices import Choice, Choices
from uvcloth.view.computation import Computation, Performance
from uvcloth.view.viewer import Viewer


def run(command: View) -> None:
    """Serve the page until Ctrl-C. Raises InputError for bad input."""
    with limited_threads(1):
        view(command)


def view(command: View) -> None:
    """Serve a page on which clips, garments, models and bodies are chosen and played, until Ctrl-C.

    Prints the page's address with the token that opens it, another one for every call. Raises InputError if
    the address cannot be listened on or viser is missing.
    """
    choices = Choices.of(
        command.motion,
        command.garment,
        command.model,
        [str(command.body)] if command.body else [],
        [str(path) for path in command.data],
    )
    first = Choice(
        motion=choices.motions[0] if command.motion or command.data else "walk",
        garments=command.garment or ("tops",),
        model=choices.models[0],
        body=choices.bodies[0],
    )
    viewer = _opened(command.host, command.port, "; Ctrl-C ends")
    viewer.offer(choices, first)
    try:
        with suppress(KeyboardInterrupt):
            viewer.run()
    finally:
        viewer.close()


class LiveAudience:
    """Live view of a rollout that another thread computes; see `Audience`."""

    def __init__(self, viewer: Viewer) -> None:
        self._viewer = viewer
        self._frames: SimpleQueue[RolloutFrame | None] = SimpleQueue()

    def begin(self, title: str, body: Body, meshes: Sequence[Mesh], count: int, fps: float) -> None:
        """Stage the garments at rest on the body."""
        frames = iter(self._frames.get, None)
        performance = Performance(title, body, meshes, count, fps, frames)
        self._viewer.show(Computation(lambda: performance).start())

    def add(self, frame: RolloutFrame) -> None:
        """Take the next frame, to be shown when its time comes."""
        self._frames.put(frame)

    def end(self) -> None:
        """Learn that no more frames come."""
        self._frames.put(None)


@contextmanager
def live_audience(port: int) -> Iterator[LiveAudience]:
    """Show what the block computes; after it, go on showing that until Ctrl-C.

    Raises InputError as `view` does.
    """
    viewer, console = _opened("127.0.0.1", port), Console(stderr=True)
    audience = LiveAudience(viewer)
    ticking = threading.Thread(target=viewer.run, name="page", daemon=True)
    ticking.start()
    try:
        yield audience
        audience.end()
        console.print(f"{viewer.address} still shows it; Ctrl-C ends", highlight=False, soft_wrap=True)
        with suppress(KeyboardInterrupt):
            ticking.join()
    finally:
        audience.end()
        viewer.close()


def _opened(host: str, port: int, end: str = "") -> Viewer:
    """A view whose address is printed, with a caution if others reach it. Raises InputError as `view`."""
    viewer = Viewer(host, port)
    for line in filter(None, (viewer.server.access.caution, f"{viewer.address} shows it{end}")):
        Console(stderr=True).print(line, highlight=False, soft_wrap=True, markup=False)
    return viewer
