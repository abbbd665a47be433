"""Roll any method out over any motion, frame after frame, in memory that does not grow with their number."""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from rasterize.errors import InputError
from uvcloth.bodies.collider import make_collider
from uvcloth.bodies.frames import LEAD, BodyFrames, body_frames
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.mesh import edge_lengths, unique_edges
from uvcloth.methods.method import Method
from uvcloth.physics.contact import Contacts, Obstacle
from uvcloth.physics.layers import Layer

LONGEST, TORN = 4.0, 0.01
"""A garment is torn when more than this share of its edges has more than so many times its rest length."""

BATCH = 8
"""Frames that the body is posed for, and that a method without memory predicts, at once."""


@dataclass(frozen=True)
class RolloutFrame:
    """One frame.

    raw, vertices: per garment (N, 3) m, world, as predicted and after contact. transforms: (J, 3, 4) and
    body_vertices: (V, 3) of the body. milliseconds: "body", "network" and "contact". contacts: what contact
    did to each garment.
    """

    index: int
    raw: tuple[Tensor, ...]
    vertices: tuple[Tensor, ...]
    transforms: Tensor
    body_vertices: Tensor
    milliseconds: Mapping[str, float]
    contacts: tuple[Contacts, ...] = ()


def rollout(
    method: Method,
    outfit: Outfit,
    transforms: Iterable[Tensor],
    fps: float,
    contact: bool = True,
    truth: Sequence[tuple[Tensor, ...]] = (),
) -> Iterator[RolloutFrame]:
    """Predict the outfit over a motion, frame after frame.

    transforms: (J, 3, 4) of each frame in turn, a tensor or a stream. The body stands still before its first
    frame. With contact, vertices inside the body (forearms and hands left out, as in the simulations) are
    moved out of it after each frame, outer garments off the inner ones that they cover, and edges get
    their rest length back; an autoregressive method may observe that.

    truth: the garments, (N, 3) m each, that an autoregressive method observes after each of the first frames
    instead of its own. Contact goes on from what it moved itself, as always. A method without memory takes no
    notice.

    Raises InputError naming the frame where a transform is not a finite number, and BrokenRolloutError where
    a prediction is not, or is torn.
    """
    state: Any = None
    resolver = _Contact(outfit) if contact else None
    limits = _Limits(outfit)
    first = 0
    for frames, body_ms in _posed(outfit, transforms, fps):
        state = method.start(outfit, frames) if state is None else state
        for part in _single(frames) if method.autoregressive else [frames]:
            begun = time.perf_counter()
            state, garments = method.step(state, part)
            network_ms = 1000.0 * (time.perf_counter() - begun) / len(part)
            for offset in range(len(part)):
                raw = tuple(vertices[offset].contiguous() for vertices in garments)
                limits.finite(raw, first + offset)
                frame = RolloutFrame(
                    index=first + offset,
                    raw=raw,
                    vertices=raw,
                    transforms=part.transforms[offset, -1],
                    body_vertices=part.vertices[offset, -1],
                    milliseconds={"body": body_ms, "network": network_ms, "contact": 0.0},
                )
                if resolver:
                    frame = resolver.resolve(frame)
                if method.autoregressive and frame.index < len(truth):
                    state = method.observe(state, truth[frame.index])
                elif method.autoregressive and resolver:
                    state = method.observe(state, frame.vertices)
                limits.whole(frame.vertices, frame.index)
                yield frame
            first += len(part)


def _posed(outfit: Outfit, transforms: Iterable[Tensor], fps: float) -> Iterator[tuple[BodyFrames, float]]:
    """The body in batches of frames, and how long posing took per frame, ms; keeps LEAD frames behind."""
    ring: list[Tensor] = []
    fresh: list[Tensor] = []

    def pose() -> tuple[BodyFrames, float]:
        begun = time.perf_counter()
        frames = body_frames(outfit.body, torch.stack(ring + fresh), fps)
        return frames, 1000.0 * (time.perf_counter() - begun) / len(fresh)

    for index, transform in enumerate(transforms):
        if not torch.isfinite(transform).all():
            raise InputError(f"frame {index} of the motion: a joint's transform is not a finite number")
        ring = ring or [transform] * LEAD
        fresh.append(transform)
        if len(fresh) == BATCH:
            yield pose()
            ring, fresh = (ring + fresh)[-LEAD:], []
    if fresh:
        yield pose()


def _single(frames: BodyFrames) -> Iterator[BodyFrames]:
    """One frame at a time, for an autoregressive method."""
    for index in range(len(frames)):
        now = slice(index, index + 1)
        yield replace(
            frames,
            transforms=frames.transforms[now],
            vertices=frames.vertices[now],
            velocity=frames.velocity[now],
            acceleration=frames.acceleration[now],
        )


class BrokenRolloutError(InputError):
    """A prediction that nothing can go on from; the frames before it are good."""


class _Limits:
    """What every prediction is held to: finite numbers, and edges that keep some likeness to rest."""

    def __init__(self, outfit: Outfit) -> None:
        self.names = [garment.name for garment in outfit.garments]
        meshes = [garment.mesh for garment in outfit.garments]
        self.edges = [unique_edges(mesh.faces) for mesh in meshes]
        self.lengths = [edge_lengths(m.vertices, edges) for m, edges in zip(meshes, self.edges, strict=True)]

    def finite(self, garments: tuple[Tensor, ...], index: int) -> None:
        """Raises BrokenRolloutError naming frame and garment."""
        for name, vertices in zip(self.names, garments, strict=True):
            if not torch.isfinite(vertices).all():
                raise BrokenRolloutError(f"frame {index}: garment {name} left the finite numbers")

    def whole(self, garments: tuple[Tensor, ...], index: int) -> None:
        """Raises BrokenRolloutError naming frame and garment."""
        for name, vertices, edges, lengths in zip(
            self.names, garments, self.edges, self.lengths, strict=True
        ):
            long = float((edge_lengths(vertices, edges) > LONGEST * lengths).float().mean())
            if long > TORN:
                raise BrokenRolloutError(
                    f"frame {index}: garment {name} is torn, {100 * long:.0f} % of its "
                    f"edges have more than {LONGEST:.0f} times their length"
                )


class _Contact:
    """Finishes the garments of an outfit, frame after frame: off the collider, edges at rest length.

    The innermost comes first, and where it ends each other one stays on its outer side. moves: what the frame
    before moved each garment's vertices, (N, 3) m.
    """

    def __init__(self, outfit: Outfit) -> None:
        meshes = [garment.mesh for garment in outfit.garments]
        body_vertices = outfit.body.mesh.vertices
        self.obstacle = Obstacle(make_collider(outfit.body), body_vertices)
        self.layers = [Layer(mesh.vertices, mesh.faces) for mesh in meshes[:-1]]
        self.garments = [
            self.obstacle.dress(mesh.vertices, mesh.faces, self.layers[:index])
            for index, mesh in enumerate(meshes)
        ]
        self.moves: list[Tensor | None] = [None] * len(meshes)

    def resolve(self, frame: RolloutFrame) -> RolloutFrame:
        """The frame with its garments resolved against its body."""
        begun = time.perf_counter()
        self.obstacle.update(frame.body_vertices)
        finished, contacts = [], []
        for index, (raw, garment) in enumerate(zip(frame.raw, self.garments, strict=True)):
            vertices, found = self.obstacle.resolve(raw, garment, self.moves[index])
            self.moves[index] = vertices - raw
            for layer in self.layers[index : index + 1]:
                layer.update(vertices)
            finished.append(vertices)
            contacts.append(found)
        spent = 1000.0 * (time.perf_counter() - begun)
        return replace(
            frame,
            vertices=tuple(finished),
            milliseconds={**frame.milliseconds, "contact": spent},
            contacts=tuple(contacts),
        )
