"""Frames for the live view, computed in a separate thread while earlier ones are shown."""

import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.geometry.mesh import Mesh
from uvcloth.rollouts.rollout import RolloutFrame


@dataclass(frozen=True)
class ShownFrame:
    """One frame to show.

    transforms: (J, 3, 4) of the body. garments: (N, 3) m each, after clearing. displacements: (N,) m each,
    by which clearing moved each vertex.
    """

    transforms: Tensor
    garments: tuple[Tensor, ...]
    displacements: tuple[Tensor, ...]

    @classmethod
    def of(cls, frame: RolloutFrame) -> "ShownFrame":
        """The part of a rollout's frame that is shown, on the CPU."""
        pairs = zip(frame.vertices, frame.raw, strict=True)
        return cls(
            frame.transforms.cpu(),
            tuple(vertices.cpu() for vertices in frame.vertices),
            tuple((after - before).norm(dim=1).cpu() for after, before in pairs),
        )


@dataclass(frozen=True)
class Performance:
    """A body in garments over frames that are computed one by one.

    meshes: the garments at rest. truth: (F, N, 3) m of the only garment as it was simulated, if it was.
    """

    title: str
    body: Body
    meshes: Sequence[Mesh]
    count: int
    fps: float
    frames: Iterator[RolloutFrame]
    truth: Tensor | None = None


class Computation:
    """A performance that is prepared and computed ahead of what is shown; nothing waits for it.

    performance: None until it is prepared. frames: those computed so far. complete: true if no more will
    come. failure: an error message, "" without an error.
    """

    def __init__(self, prepare: Callable[[], Performance]) -> None:
        self.performance: Performance | None = None
        self.frames: list[ShownFrame] = []
        self.complete = False
        self.failure = ""
        self._prepare = prepare
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="view", daemon=True)

    def start(self) -> "Computation":
        """Start, and return at once."""
        self._thread.start()
        return self

    def stop(self) -> None:
        """Compute no further frame."""
        self._stopped.set()

    def wait(self, seconds: float | None = None) -> None:
        """Wait for its end."""
        self._thread.join(seconds)

    def _run(self) -> None:
        try:
            performance = self._prepare()
            self.performance = performance
            for frame in performance.frames:
                if self._stopped.is_set():
                    return
                self.frames.append(ShownFrame.of(frame))
        except InputError as error:
            self.failure = str(error)
        finally:
            self.complete = True
