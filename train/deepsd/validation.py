"""Validation of DeePSD on outfits that it is not trained on: errors, measures of the cloth, a picture."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from uvcloth.bodies.collider import Collider, make_collider
from uvcloth.bodies.posing import posed_skin
from uvcloth.geometry.skinning import skin
from uvcloth.methods.deepsd.network import Branch
from uvcloth.physics.measures import edge_change, fold_cosine
from uvcloth.physics.obstacle import ContactGarment, Obstacle
from uvcloth.rendering.render import BODY_COLOR, GARMENT_COLORS, Surface, contact_sheet, render, three_quarter

from .dataset import OutfitFrames
from .losses import MILLI
from .prediction import DrawnPoses, PosedOutfit, describe, pose_outfits

Energy = Callable[[OutfitFrames, PosedOutfit, Tensor], Tensor]
"""The energy () of an outfit in Q poses, joint transforms (Q, J, 3, 4)."""

OUTFITS = 48
"""Most validation outfits to evaluate."""

POSES = 8
"""Most poses of each."""

INSIDE_POSES = 2
"""Poses in which the vertices inside the body are counted, which is slow."""

PICTURED = 4
"""Validation outfits in the picture, each in one pose."""

PICTURE_SIZE = (300, 400)
"""Width and height of a pictured outfit, pixels."""


@dataclass(frozen=True)
class HeldOutfit:
    """An outfit in the Q poses that it is validated in.

    truth: (Q, U, 3) m, none where it is not known. obstacle: its body; contact: the outfit as it meets it.
    """

    frames: OutfitFrames
    poses: DrawnPoses
    truth: Tensor
    obstacle: Obstacle
    contact: ContactGarment

    @property
    def faces(self) -> Tensor:
        """Its faces (F, 3)."""
        return torch.cat(self.frames.graph.faces)

    def bodies(self) -> Tensor:
        """Its body's vertices (Q, V, 3) m."""
        return posed_skin(self.frames.body, self.poses.transforms[0].cpu())


class Validation:
    """Outfits that are not trained on, in poses spread over their frames, alike at every validation."""

    def __init__(self, held: Sequence[OutfitFrames], device: torch.device) -> None:
        self.device = device
        selection = [held[index] for index in _spread(len(held), OUTFITS)]
        collider = make_collider(selection[0].body)
        self._held = [self._hold(each, collider) for each in selection]

    def _hold(self, frames: OutfitFrames, collider: Collider) -> HeldOutfit:
        rows = _spread(len(frames.vectors), POSES)
        body, graph = frames.body, frames.graph
        obstacle = Obstacle(collider, body.mesh.vertices)
        return HeldOutfit(
            frames,
            DrawnPoses(
                frames.vectors[rows][None].to(self.device), frames.transforms[rows][None].to(self.device)
            ),
            frames.vertices[rows] if len(frames.vertices) else frames.vertices,
            obstacle,
            obstacle.contact_garment(graph.points),
        )

    @torch.no_grad()
    def measure(self, net: Any, branches: Sequence[Branch], energy: Energy | None = None) -> dict[str, float]:
        """Means over the outfits, each weighing alike.

        energy_mJ: what `energy` gives. mean_mm, smooth_lbs_mm: vertex error, and that of smooth skinning,
        where the truth is known. edge_mm, bend_cos: see uvcloth.physics.measures. inside_percent: of points.
        """
        columns: dict[str, list[Tensor]] = {}
        for held, outfit in self._predicted(net, branches, self._held):
            measures = self._measures(held, outfit.posed.cpu())
            if energy is not None:
                measures = {"energy_mJ": energy(held.frames, outfit, held.poses.transforms[0])} | measures
            for name, value in measures.items():
                columns.setdefault(name, []).append(value.cpu())
        return {name: float(torch.stack(values).mean()) for name, values in columns.items()}

    def _predicted(
        self, net: Any, branches: Sequence[Branch], outfits: Sequence[HeldOutfit]
    ) -> Iterator[tuple[HeldOutfit, PosedOutfit]]:
        """Some outfits, each as it is predicted."""
        for held in outfits:
            described = describe(net, [held.frames.graph], self.device)
            yield held, pose_outfits(net, described, held.poses, branches)[0]

    def _measures(self, held: HeldOutfit, posed: Tensor) -> dict[str, Tensor]:
        """Measures of an outfit (Q, U, 3) m."""
        graph = held.frames.graph
        measures = {}
        if len(held.truth):
            skinned = skin(graph.points, graph.smooth, held.poses.transforms[0].cpu())
            measures["mean_mm"] = MILLI * (posed - held.truth).norm(dim=-1).mean()
            measures["smooth_lbs_mm"] = MILLI * (skinned - held.truth).norm(dim=-1).mean()
        bodies = held.bodies()
        some = _spread(len(posed), INSIDE_POSES)
        inside = held.obstacle.inside_percent(posed[some].contiguous(), held.contact, bodies[some])
        return measures | {
            "edge_mm": MILLI * edge_change(posed, graph.points, held.faces).mean(),
            "bend_cos": fold_cosine(posed, held.faces).mean(),
            "inside_percent": inside.mean(),
        }

    @torch.no_grad()
    def picture(self, net: Any, branches: Sequence[Branch]) -> Tensor:
        """A few outfits as predicted and, where it is known, as simulated below: (H, W, 3) uint8."""
        selection = [self._held[index] for index in _spread(len(self._held), PICTURED)]
        rows: list[list[Any]] = [[], []]
        for held, outfit in self._predicted(net, branches, selection):
            middle = len(outfit.posed) // 2
            body = held.bodies()[middle]
            rows[0].append(_drawn(held.frames, outfit.posed[middle].cpu(), body))
            if len(held.truth):
                rows[1].append(_drawn(held.frames, held.truth[middle], body))
        return torch.from_numpy(contact_sheet([*rows[0], *rows[1]], columns=len(selection)))


def _drawn(frames: OutfitFrames, posed: Tensor, body: Tensor) -> Any:
    """An outfit (U, 3) m on its body (V, 3) m, rendered."""
    surfaces = [Surface(body, frames.body.mesh.faces, BODY_COLOR)]
    for index, faces in enumerate(frames.graph.faces):
        surfaces.append(Surface(posed, faces, GARMENT_COLORS[index % len(GARMENT_COLORS)]))
    camera = three_quarter(body, aspect=PICTURE_SIZE[0] / PICTURE_SIZE[1])
    return render(surfaces, camera, PICTURE_SIZE, float(body[:, 2].min()))


def _spread(count: int, most: int) -> list[int]:
    """At most so many of `count` indices, evenly spread."""
    kept = min(count, most)
    return [(2 * index + 1) * count // (2 * kept) for index in range(kept)]
