"""The live view: a page in the browser, its controls, and the clock that plays what is computed.

All meshes of a frame leave in one message of the WebSocket, and around the figure's root: so body and cloth
never part, and the camera follows the figure.
"""

import asyncio
import threading
from collections.abc import Callable
from contextlib import redirect_stdout
from html import escape
from io import StringIO
from typing import Any

import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.garments.cage import QUALITIES
from uvcloth.methods.finish_names import FINISHES
from uvcloth.physics.fabric import FABRICS
from uvcloth.view.choices import Choice, Choices
from uvcloth.view.computation import Computation, Performance, ShownFrame
from uvcloth.view.heat import CLEARING, ERROR, QUANTITIES, STRETCH, Quantity, Stretch, legend
from uvcloth.view.stage import Actor, Floor

NO_HEAT = "none"

USUAL = "usual"
"""Finish that the model has by default, and fabric of the training data."""

ASIDE = -1.2
"""Metres along x from the predicted body to the simulated one."""

HOST = "127.0.0.1"
"""Address of the page: this machine only, because a visitor of the page can choose what is computed."""

IDLE_SECONDS = 0.1
"""Time between two looks at the controls while nothing plays."""


class Viewer:
    """A page at a port of this machine. `tick` looks at the controls once and shows what they ask for.

    host, port: the address that is listened on. Raises InputError as `listen` does, and without viser.
    Everything but the computation happens in the thread that ticks, so that nothing needs a lock.
    """

    def __init__(self, host: str = HOST, port: int = 8080) -> None:
        try:
            from uvcloth.view.server import PrivateServer
        except ModuleNotFoundError as error:
            raise InputError("the live view needs viser: install uvcloth[view]") from error
        # viser prints a banner even if it is not verbose.
        with redirect_stdout(StringIO()):
            self.server: Any = PrivateServer(host, port)
        self.server.scene.set_up_direction("+z")
        self._floor = Floor(self.server.scene)
        self.server.initial_camera.position = (2.2, -4.6, 1.7)
        self.server.initial_camera.look_at = (0.5, 0.0, 0.9)
        self.server.initial_camera.fov = 0.7
        self.shown = -1
        """Index of the frame that is shown, -1 before the first."""
        self._computation: Computation | None = None
        self._staged: Computation | None = None
        self._performance: Performance | None = None
        self._actors: list[Actor] = []
        self._stretches: list[Stretch] = []
        self._drawn: tuple[int, str] = (-1, NO_HEAT)
        self._closed = threading.Event()
        self._sending = threading.Lock()
        gui: Any = self.server.gui
        self._state = gui.add_html("")
        self._playing = gui.add_checkbox("Play", True)
        self._frame = gui.add_slider("Frame", min=0, max=1, step=1, initial_value=0)
        self._speed = gui.add_slider("Speed", min=0.1, max=2.0, step=0.1, initial_value=1.0)
        self._heat = gui.add_dropdown("Heat map", (NO_HEAT, *(quantity.label for quantity in QUANTITIES)))
        self._legend = gui.add_html("")
        self._selection: Callable[[], Choice] | None = None
        self._choices: Choices | None = None
        self._choice: Choice | None = None
        self.controls: dict[str, Any] = {}
        """The controls by name: motion, model, body, finish, fabric, quality, and a box for each garment."""

    @property
    def address(self) -> str:
        """Address of the page for a browser on this machine, with the token that opens it."""
        address: str = self.server.access.address
        return address

    def offer(self, choices: Choices, first: Choice) -> None:
        """Add controls that choose what is computed, `first` to begin with."""
        gui: Any = self.server.gui
        with gui.add_folder("Roll out"):
            motion = gui.add_dropdown("Motion", choices.motions, initial_value=first.motion)
            garments = {name: gui.add_checkbox(name, name in first.garments) for name in choices.garments}
            model = gui.add_dropdown("Model", choices.models, initial_value=first.model)
            body = gui.add_dropdown("Body", choices.bodies, initial_value=first.body)
            finish = gui.add_dropdown("Finish", (USUAL, *FINISHES), initial_value=first.finish or USUAL)
            fabric = gui.add_dropdown("Fabric", (USUAL, *FABRICS), initial_value=first.fabric or USUAL)
            quality = gui.add_dropdown("Quality", tuple(QUALITIES), initial_value=first.quality)
        self.controls = {"motion": motion, "model": model, "body": body, "finish": finish}
        self.controls |= {"fabric": fabric, "quality": quality, **garments}
        self._choices = choices
        self._selection = lambda: Choice(
            motion=motion.value,
            garments=tuple(name for name in choices.garments if garments[name].value),
            model=model.value,
            body=body.value,
            finish=None if finish.value == USUAL else finish.value,
            fabric=None if fabric.value == USUAL else fabric.value,
            quality=quality.value,
        )

    def show(self, computation: Computation) -> None:
        """Show a computation from its first frame on; the one before is stopped, and is played until then."""
        if self._computation is not None:
            self._computation.stop()
        self._computation = computation

    def run(self) -> None:
        """Tick until `close` is called or Ctrl-C is pressed."""
        while not self._closed.wait(self._pause()):
            self.tick()

    def close(self) -> None:
        """Stop the computation and the server."""
        self._closed.set()
        if self._computation is not None:
            self._computation.stop()
        with self._sending, redirect_stdout(StringIO()):
            self.server.stop()

    def tick(self) -> None:
        """Look at the controls once and show what they ask for."""
        if self._selection is not None and self._choices is not None:
            choice, choices = self._selection(), self._choices
            if choice != self._choice:
                self._choice = choice
                self.show(Computation(lambda: choices.perform(choice)).start())
        computation = self._computation
        if computation is None:
            return
        with self._sending:
            if not self._closed.is_set() and (computation.frames or self._staged):
                sent = asyncio.run_coroutine_threadsafe(self._advance(), self.server.get_event_loop())
                sent.result()
        self._tell(computation)

    async def _advance(self) -> None:
        """Stage the computation once it has a frame, and play.

        This runs in the thread that sends, which puts all that is waiting into one message.
        """
        if self._computation is not self._staged and self._computation and self._computation.frames:
            self._staged = self._computation
            assert self._staged.performance is not None
            self._stage(self._staged.performance)
        if self._staged is not None:
            self._play(self._staged)

    def _pause(self) -> float:
        """Seconds until the next tick."""
        if self._performance is None or not self._playing.value:
            return IDLE_SECONDS
        return 1.0 / (self._performance.fps * self._speed.value)

    def _stage(self, performance: Performance) -> None:
        """Replace the meshes of the scene by those of a performance."""
        for actor in self._actors:
            actor.remove()
        scene, body, meshes = self.server.scene, performance.body, performance.meshes
        self._actors = [Actor(scene, "predicted", body, meshes)]
        if performance.truth is not None:
            self._actors.append(Actor(scene, "simulated", body, meshes, ASIDE))
        self._stretches = [Stretch(mesh) for mesh in meshes]
        self._performance, self.shown, self._drawn = performance, -1, (-1, NO_HEAT)
        self._frame.max = max(performance.count - 1, 1)
        self._frame.value = 0

    def _tell(self, computation: Computation) -> None:
        """Show the progress of the computation; file names are escaped."""
        performance, done = computation.performance, len(computation.frames)
        if computation.failure:
            text = f"<b>{escape(computation.failure)}</b>"
        elif performance is None:
            text = "preparing ..."
        elif computation.complete:
            text = f"{escape(performance.title)}: {done} frames"
        else:
            text = f"{escape(performance.title)}: {done} of {performance.count} frames computed"
        if self._state.content != text:
            self._state.content = text

    def _play(self, computation: Computation) -> None:
        """Show the frame that is due, or the one that the slider was moved to."""
        last = len(computation.frames) - 1
        index = int(self._frame.value)
        if self._playing.value and index == self.shown:
            ended = computation.complete and index >= last
            index = 0 if ended else index + 1
        index = min(index, last)
        if self._drawn != (index, self._heat.value):
            self._draw(index, computation.frames[index])
        if self._frame.value != index:
            self._frame.value = index
        self.shown = index

    def _draw(self, index: int, frame: ShownFrame) -> None:
        """Move all meshes to a frame, with the chosen heat map."""
        label = self._heat.value
        truth = None if self._performance is None else self._performance.truth
        quantity = next((each for each in QUANTITIES if each.label == label), None)
        if quantity is ERROR and truth is None:
            quantity = None
            self._legend.content = "<small>an error needs a simulated sequence (--data)</small>"
        elif self._drawn[1] != label:
            self._legend.content = "" if quantity is None else legend(quantity)
        largest = 1.0 if quantity is None else quantity.largest
        simulated = None if truth is None else (truth[index],)
        place = self._place(frame)
        self._floor.move(place)
        transforms = torch.cat([frame.transforms[..., :3], frame.transforms[..., 3:] - place[:, None]], -1)
        values = self._values(quantity, frame, simulated)
        self._actors[0].move(transforms, [garment - place for garment in frame.garments], values, largest)
        if simulated is not None:
            stretched = [measure(simulated[0]) for measure in self._stretches]
            values = stretched if quantity is STRETCH else None
            self._actors[1].move(transforms, [each - place for each in simulated], values, largest)
        self._drawn = (index, label)

    def _place(self, frame: ShownFrame) -> Tensor:
        """Place (3,) m on the floor below the root of the figure."""
        assert self._performance is not None
        root, heads = frame.transforms[0], self._performance.body.skeleton.heads
        return (root[:, :3] @ heads[0] + root[:, 3]) * torch.tensor([1.0, 1.0, 0.0])

    def _values(
        self, quantity: Quantity | None, frame: ShownFrame, simulated: tuple[Tensor, ...] | None
    ) -> list[Tensor] | None:
        """Values (N,) of the predicted garments; None without a heat map."""
        if quantity is STRETCH:
            pairs = zip(self._stretches, frame.garments, strict=True)
            return [measure(vertices) for measure, vertices in pairs]
        if quantity is CLEARING:
            return list(frame.displacements)
        if quantity is ERROR and simulated is not None:
            pairs_of = zip(frame.garments, simulated, strict=True)
            return [torch.linalg.vector_norm(one - other, dim=1) for one, other in pairs_of]
        return None
