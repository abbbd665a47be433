"""Roll any method out over any motion, frame after frame, in memory that does not grow with their number."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from uvcloth.bodies.frames import BodyFrames, side_by_side
from uvcloth.bodies.stream import posed_batches
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.mesh import edge_lengths, unique_edges
from uvcloth.geometry.records import CPU, to_device
from uvcloth.geometry.skinning import skin
from uvcloth.methods.capabilities import before_finish, feed_back
from uvcloth.methods.method import Method

if TYPE_CHECKING:
    from uvcloth.garments.proxy import ProxiedOutfit
    from uvcloth.physics.outfit_clearing import OutfitClearing
    from uvcloth.physics.visibility import VisibilityTest

LONGEST, TORN = 4.0, 0.01
"""A garment is torn when more than the share TORN of its edges is longer than LONGEST times its rest length.
"""

NOTICEABLE = 0.02
"""Metres by which such an edge has to be longer than at rest for a person to notice it."""

MOST_LOOKED_AT = 64
"""Longest edges of a frame of which it is found whether they are seen."""

JUMPED = "the motion jumps, and the garments start again"
STRETCHED = f"an edge of a garment that is seen has more than {LONGEST:.0f} times its length"


@dataclass(frozen=True)
class RolloutFrame:
    """One frame.

    raw, vertices: per garment (N, 3) m, as predicted and after clearing. transforms: (J, 3, 4) and
    body_vertices: (V, 3) of the body. All places are relative to the origin (3,) m, world, float64.
    milliseconds: "body", "network" and "clearing". replaced: messages on garments without a valid prediction,
    which linear blend skinning replaced. difficulties: messages on what made the frame difficult, the same
    words in every frame.
    """

    index: int
    raw: tuple[Tensor, ...]
    vertices: tuple[Tensor, ...]
    transforms: Tensor
    body_vertices: Tensor
    milliseconds: Mapping[str, float]
    replaced: tuple[str, ...] = ()
    difficulties: tuple[str, ...] = ()
    origin: Tensor = field(default_factory=lambda: torch.zeros(3, dtype=torch.float64))

    def in_world(self) -> "RolloutFrame":
        """The frame with all places in the world, in float32."""
        return replace(
            self,
            raw=tuple(_displaced(vertices, self.origin) for vertices in self.raw),
            vertices=tuple(_displaced(vertices, self.origin) for vertices in self.vertices),
            transforms=_transformed(self.transforms, self.origin),
            body_vertices=_displaced(self.body_vertices, self.origin),
            origin=torch.zeros_like(self.origin),
        )


@dataclass(frozen=True)
class PreparedRollout:
    """A method with an outfit on a device: the data that all their rollouts share.

    prepared: what the method works out for the outfit. clearing: keeps the outfit off the body, None without
    it. clock: seconds, by which the times of frames are measured.
    """

    method: Method
    outfit: Outfit
    prepared: Any
    limits: "EdgeLimits"
    clearing: "OutfitClearing | None"
    clock: Callable[[], float] = time.perf_counter

    def frames(
        self,
        transforms: Iterable[Tensor],
        fps: float,
        truth: Sequence[tuple[Tensor, ...]] = (),
        every: int = 1,
        keep_going: bool = False,
    ) -> Iterator[RolloutFrame]:
        """Predict the outfit over a motion, frame after frame; see `rollout`. One rollout at a time."""
        for frame in self.around_root(transforms, fps, truth, every, keep_going):
            yield frame.in_world()

    def around_root(
        self,
        transforms: Iterable[Tensor],
        fps: float,
        truth: Sequence[tuple[Tensor, ...]] = (),
        every: int = 1,
        keep_going: bool = False,
        first: int = 0,
    ) -> Iterator[RolloutFrame]:
        """The same frames as they are computed: around origins that follow the body's root.

        first: index of the first frame.
        """
        method, state, start = self.method, None, first
        needs_clearing = True
        origin = torch.zeros(3, dtype=torch.float64)
        for batch in posed_batches(self.outfit.body, transforms, fps):
            frames, begins = batch.frames, batch.begins
            if begins:
                state, needs_clearing = method.init(self.prepared, frames[:1]), True
            else:
                state = method.displaced(
                    self.prepared, state, (origin - batch.origin)[None].to(frames.vertices)
                )
            origin = batch.origin
            for indices, part in _parts(frames, start, method.traits.autoregressive, every):
                begun = self.clock()
                state, garments = method.step(self.prepared, state, part)
                network_ms = 1000.0 * (self.clock() - begun) / len(part)
                for offset, index in enumerate(indices):
                    raw = tuple(vertices[offset].contiguous() for vertices in garments)
                    frame = RolloutFrame(
                        index=index,
                        raw=raw,
                        vertices=raw,
                        transforms=part.transforms[offset, -1],
                        body_vertices=part.vertices[offset, -1],
                        origin=origin,
                        milliseconds={"body": batch.milliseconds, "network": network_ms, "clearing": 0.0},
                        difficulties=(JUMPED,) if begins and index == start > first else (),
                    )
                    frame = self._without(frame, self.limits.not_finite(raw), keep_going)
                    wanted = index % every == 0
                    if wanted or needs_clearing:
                        cleared = self._cleared(frame)
                        now = self.limits.measured(cleared.vertices)
                        torn = self.limits.torn(now)
                        # Skinning tears where its weights do: it goes on, and is what replaces others.
                        if torn and not method.traits.is_baseline:
                            cleared = self._cleared(self._without(frame, torn, keep_going))
                            now = self.limits.measured(cleared.vertices)
                        frame = cleared
                        if self.limits.stretched(now, frame.vertices, frame.body_vertices):
                            frame = replace(frame, difficulties=(*frame.difficulties, STRETCHED))
                    if method.traits.autoregressive and frame.replaced:
                        # What it remembers may be as broken as what it predicted.
                        state = method.init(self.prepared, part)
                    if method.traits.autoregressive and (
                        0 <= index < len(truth) or self.clearing or frame.replaced
                    ):
                        feedback = (
                            tuple(_displaced(vertices, -origin) for vertices in truth[index])
                            if 0 <= index < len(truth)
                            else frame.vertices
                        )
                        batched = tuple(vertices[None].to(raw[0].device) for vertices in feedback)
                        following = feed_back(method, self.prepared, state, batched)
                        needs_clearing, state = following is not state, following
                    if wanted:
                        yield frame
            start += len(frames)

    def _without(self, frame: RolloutFrame, broken: Mapping[int, str], keep_going: bool) -> RolloutFrame:
        """The frame with its broken garments (by place, with the reason) as linear blend skinning moves them.

        Raises BrokenRolloutError naming frame and garment unless the rollout is to keep going.
        """
        reasons = tuple(
            f"frame {frame.index}: garment {self.outfit.garments[place].name} {reason}"
            for place, reason in broken.items()
        )
        if reasons and not keep_going:
            raise BrokenRolloutError(reasons[0])
        raw = list(frame.raw)
        for place in broken:
            garment = self.outfit.garments[place]
            raw[place] = skin(garment.mesh.vertices, garment.smooth_weights, frame.transforms[None])[0]
        return replace(frame, raw=tuple(raw), vertices=tuple(raw), replaced=frame.replaced + reasons)

    def _cleared(self, frame: RolloutFrame) -> RolloutFrame:
        """The frame with its garments moved off its body."""
        if self.clearing is None:
            return frame
        begun = self.clock()
        vertices = self.clearing.cleared(frame.raw, frame.body_vertices)
        spent = 1000.0 * (self.clock() - begun)
        return replace(frame, vertices=vertices, milliseconds={**frame.milliseconds, "clearing": spent})


def prepare_rollout(
    method: Method, outfit: Outfit, clear: bool = True, device: torch.device = CPU
) -> PreparedRollout:
    """Compute the data that all rollouts of a method with an outfit share; each rollout then computes only
    frames.

    Raises InputError for an outfit that the method does not support.
    """
    clear = clear and not method.traits.keeps_off_body
    if clear:
        method = before_finish(method)
    prepared, clearing = method.prepare(outfit, device), None
    if clear:
        # Training validates without clearing on machines that have no compiler for it.
        from uvcloth.physics.outfit_clearing import OutfitClearing

        clearing = OutfitClearing.of(outfit.body, [garment.mesh for garment in outfit.garments])
    outfit = to_device(outfit, device)
    return PreparedRollout(method, outfit, prepared, EdgeLimits(outfit), clearing)


def rollout(
    method: Method,
    outfit: Outfit,
    transforms: Iterable[Tensor],
    fps: float,
    clear: bool = True,
    truth: Sequence[tuple[Tensor, ...]] = (),
    device: torch.device = CPU,
    every: int = 1,
    keep_going: bool = False,
) -> Iterator[RolloutFrame]:
    """Predict the outfit over a motion, frame after frame.

    transforms: (J, 3, 4) of each frame in turn, a tensor or a stream. The body stands still before its first
    frame. clear: after each frame, vertices in the body are moved out of it, and outer garments off the inner
    ones that they cover (`OutfitClearing`); that is fed back to an autoregressive method. A method leaves out
    what clearing does with less error (`FinishAware`), so that its predictions may differ from those without
    it; a method that keeps garments off the body by itself is not cleared.

    truth: the garments, (N, 3) m each, that are fed back to an autoregressive method after each of the first
    frames instead of its own. Other methods ignore it. device: all but clearing runs on it.

    every: yield one of this many frames; only these are predicted, unless the method is autoregressive, and
    only these are cleared, unless the method continues from the cleared garments. keep_going:
    in a frame where a garment is torn or not finite, linear blend skinning replaces it, the frame reports
    this, and the replacement is fed back.

    Raises InputError naming the frame where a transform is not a finite number, and BrokenRolloutError where
    a prediction is not, or is torn by a method that is no baseline, and the rollout is not to keep going.
    """
    yield from prepare_rollout(method, outfit, clear, device).frames(
        transforms, fps, truth, every, keep_going
    )


def with_proxies(outfit: Outfit, method: Method) -> "ProxiedOutfit":
    """Replace coarse garments by proxies, except for a method that was trained on these meshes."""
    from uvcloth.garments.proxy import ProxiedOutfit

    proxied = ProxiedOutfit.of(outfit)
    return ProxiedOutfit.as_is(outfit) if method.unsupported_reason(proxied.outfit) else proxied


def rollout_proxied(
    method: Method,
    proxied: "ProxiedOutfit",
    transforms: Iterable[Tensor],
    fps: float,
    clear: bool = True,
    *,
    device: torch.device = CPU,
    every: int = 1,
    keep_going: bool = False,
    first: int = 0,
) -> Iterator[RolloutFrame]:
    """Predict an outfit as `rollout` does, and yield frames of the meshes that are shown, on the CPU.

    With clearing, inner garments are pressed beneath the faces of those over them (`Pressing`), except by a
    method that keeps its meshes apart by itself. Their places are relative to origins that follow the body's
    root. first: index of the first frame.
    """
    from uvcloth.physics.pressing import Pressing

    prepared = prepare_rollout(method, proxied.outfit, clear, device)
    kept_apart = len(proxied.meshes) == 1 or (method.traits.keeps_off_body and proxied.contact is None)
    pressing = Pressing.of(proxied.meshes) if clear and not kept_apart else None
    for predicted in prepared.around_root(transforms, fps, every=every, keep_going=keep_going, first=first):
        frame = to_device(predicted, CPU)
        if proxied.contact is None and pressing is None:
            yield frame
            continue
        begun = time.perf_counter()
        vertices = proxied.shown(frame.vertices, frame.body_vertices)
        vertices = pressing.pressed(vertices) if pressing else vertices
        spent = frame.milliseconds["clearing"] + 1000.0 * (time.perf_counter() - begun)
        milliseconds = {**frame.milliseconds, "clearing": spent}
        yield replace(
            frame, raw=proxied.mesh_vertices(frame.raw), vertices=vertices, milliseconds=milliseconds
        )


def roll_out_together(
    method: Method,
    prepared: Any,
    outfit: Outfit,
    motions: Sequence[Tensor],
    fps: float,
    under: Sequence[Tensor] = (),
) -> Iterator[tuple[Tensor, ...]]:
    """Predict an outfit over several motions (T, J, 3, 4) side by side, without contact, on their device.

    Yields, frame after frame until the first of them ends, the garments (B, N, 3) m of all. outfit: on that
    device. under: (T, N, 3) m of each motion, what is worn beneath, for a method that needs it.
    """
    streams = [posed_batches(outfit.body, motion, fps, jumps=False) for motion in motions]
    state: Any = None
    index = 0
    before = torch.zeros(len(motions), 3, dtype=torch.float64)
    for batches in zip(*streams, strict=False):
        origins = torch.stack([batch.origin for batch in batches])
        for turn, parts in enumerate(zip(*(_single(batch.frames) for batch in batches), strict=False)):
            frames = side_by_side(parts)
            if under:
                beneath = zip(under, origins, strict=True)
                placed = [_displaced(vertices[index], -origin) for vertices, origin in beneath]
                frames = replace(frames, under=torch.stack(placed))
            if index == 0:
                state = method.init(prepared, frames)
            elif turn == 0:
                state = method.displaced(prepared, state, (before - origins).to(frames.vertices))
            state, garments = method.step(prepared, state, frames)
            yield tuple(_displaced(vertices, origins[:, None]) for vertices in garments)
            index += 1
        before = origins


def _displaced(points: Tensor, shift: Tensor) -> Tensor:
    """Points (..., 3) m displaced by a shift in float64 that broadcasts to them."""
    return (points.double() + shift.to(points.device)).to(points.dtype)


def _transformed(transforms: Tensor, shift: Tensor) -> Tensor:
    """Transforms (..., 3, 4) followed by a shift (3,) in float64, m."""
    return torch.cat([transforms[..., :3], _displaced(transforms[..., 3], shift)[..., None]], dim=-1)


def _single(frames: BodyFrames) -> Iterator[BodyFrames]:
    """One frame at a time, for an autoregressive method."""
    for index in range(len(frames)):
        yield frames[index : index + 1]


def _parts(
    frames: BodyFrames, start: int, autoregressive: bool, every: int
) -> Iterator[tuple[Sequence[int], BodyFrames]]:
    """Frames that are predicted at once, each with its index; start: the index of the first of `frames`."""
    if autoregressive:
        yield from (([start + offset], part) for offset, part in enumerate(_single(frames)))
        return
    first = -start % every
    if first < len(frames):
        yield range(start + first, start + len(frames), every), frames[first::every]


class BrokenRolloutError(InputError):
    """A prediction from which the rollout cannot continue; the frames before it are good."""


class EdgeLimits:
    """Limits of every prediction: finite numbers, and edges that are not far longer than at rest."""

    def __init__(self, outfit: Outfit) -> None:
        meshes = [garment.mesh for garment in outfit.garments]
        self.edges = [unique_edges(mesh.faces) for mesh in meshes]
        self.lengths = [edge_lengths(m.vertices, edges) for m, edges in zip(meshes, self.edges, strict=True)]
        self._faces = [outfit.body.mesh.faces, *(mesh.faces for mesh in meshes)]
        self._onlooker: VisibilityTest | None = None

    def not_finite(self, garments: tuple[Tensor, ...]) -> dict[int, str]:
        """A message on each garment that is not finite, by its place in the outfit."""
        return {
            place: "left the finite numbers"
            for place, vertices in enumerate(garments)
            if not torch.isfinite(vertices).all()
        }

    def measured(self, garments: tuple[Tensor, ...]) -> list[Tensor]:
        """Lengths (E,) m of the edges of each garment (N, 3) m."""
        return [edge_lengths(vertices, edges) for vertices, edges in zip(garments, self.edges, strict=True)]

    def torn(self, now: Sequence[Tensor]) -> dict[int, str]:
        """A message on each torn garment, by place. now: (E,) m of each, as `measured` gives them."""
        reasons = {}
        for place, (measured, lengths) in enumerate(zip(now, self.lengths, strict=True)):
            share = float((measured > LONGEST * lengths).float().mean())
            if share > TORN:
                portion = f"{100 * share:.0f} % of its edges have"
                reasons[place] = f"is torn, {portion} more than {LONGEST:.0f} times their length"
        return reasons

    def stretched(self, now: Sequence[Tensor], garments: tuple[Tensor, ...], body_vertices: Tensor) -> bool:
        """True if a person sees an edge that is far longer than at rest, on the posed body (V, 3) m.

        now: (E,) m of each garment (N, 3) m, as `measured` gives them.
        """
        from uvcloth.physics.shell import Shell
        from uvcloth.physics.visibility import VisibilityTest

        middles = []
        for measured, vertices, edges, lengths in zip(now, garments, self.edges, self.lengths, strict=True):
            longer = measured - lengths
            longer = torch.where(longer > (LONGEST - 1.0) * lengths, longer, 0.0)
            longest = longer.topk(min(MOST_LOOKED_AT, len(longer)))
            worst = edges[longest.indices[longest.values > NOTICEABLE]]
            middles.append(vertices[worst].mean(1))
        points = torch.cat(middles)
        if not len(points):
            return False
        meshes = [body_vertices, *garments]
        if self._onlooker is None:
            shells = tuple(Shell(*mesh) for mesh in zip(meshes, self._faces, strict=True))
            self._onlooker = VisibilityTest(shells)
        self._onlooker.update(meshes)
        return self._onlooker.sees_any(points)
