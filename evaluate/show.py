"""Animations and rendered pictures of the judged windows for the report."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from uvcloth.bodies.posing import posed_skin
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.mesh import join_meshes
from uvcloth.render import BODY_COLOR, Color, Surface, contact_sheet, render, three_quarter

from .case import outfit_name
from .report import Picture
from .viewer import ViewerClip

MOMENTS = (0.3, 0.6, 0.9)
"""Shares of a window at which it is pictured."""

PICTURE_SIZE = (200, 300)
"""Width and height of one pictured moment, in pixels."""

SIMULATION_COLOR: Color = (0.43, 0.45, 0.50)
METHOD_COLORS: tuple[Color, ...] = (
    (0.60, 0.56, 0.50),
    (0.79, 0.63, 0.23),
    (0.18, 0.44, 0.70),
    (0.76, 0.34, 0.17),
    (0.36, 0.56, 0.31),
    (0.54, 0.35, 0.66),
    (0.25, 0.60, 0.63),
    (0.70, 0.30, 0.47),
)
"""The same as --m0, --m1, ... in templates/report.css."""


@dataclass(frozen=True)
class Shown:
    """The parts of a judged case that are shown.

    meshes: by name, the simulation first, then the methods that support the outfit, all its garments as one,
    (S, N, 3) metres. transforms: (S, J, 3, 4). fps: of the S frames.
    """

    action: str
    clip: str
    outfit: Outfit
    fps: float
    stride: int
    transforms: Tensor
    meshes: Mapping[str, Tensor]

    @property
    def outfit_name(self) -> str:
        """The name of the outfit, that of its garment where it is one."""
        return outfit_name([garment.name for garment in self.outfit.garments])

    @property
    def faces(self) -> Tensor:
        """Faces (M, 3) of all garments as one mesh."""
        return join_meshes((each.mesh.vertices, each.mesh.faces) for each in self.outfit.garments).faces

    @property
    def mean_speed(self) -> float:
        """Mean speed of the simulated garments in m/s, from frame to frame shown."""
        simulated = next(iter(self.meshes.values()))
        return (
            float(torch.diff(simulated, dim=0).norm(dim=-1).mean()) * self.fps if len(simulated) > 1 else 0.0
        )


def viewer_clips(shown: Sequence[Shown]) -> list[ViewerClip]:
    """The fastest case of each outfit, where methods differ most."""
    clips = []
    for name in outfits_shown(shown):
        s = max((s for s in shown if s.outfit_name == name), key=lambda s: s.mean_speed)
        clips.append(
            ViewerClip(s.action, name, s.fps, s.stride, s.faces, s.outfit.body, s.transforms, s.meshes)
        )
    return clips


def outfits_shown(shown: Sequence[Shown]) -> dict[str, Outfit]:
    """The outfits that were judged, by name."""
    return {each.outfit_name: each.outfit for each in shown}


def pictured(shown: Sequence[Shown]) -> list[Shown]:
    """One case per action, taking the outfits in turn, so that all are seen."""
    cases = []
    outfits = list(outfits_shown(shown))
    for index, action in enumerate(dict.fromkeys(each.action for each in shown)):
        of_action = [each for each in shown if each.action == action]
        wanted = [each for each in of_action if each.outfit_name == outfits[-1 - index % len(outfits)]]
        cases.append((wanted or of_action)[0])
    return cases


def method_color(methods: Sequence[str], name: str) -> Color:
    """The colour of one of the methods, the same in every picture and chart."""
    return METHOD_COLORS[methods.index(name) % len(METHOD_COLORS)]


def pictures(shown: Sequence[Shown], methods: Sequence[str], tick: Callable[[], None]) -> Iterator[Picture]:
    """One picture per case: a row per moment, the simulation first, then every method.

    methods: all that were judged on anything, in order. tick: called after each picture.
    """
    for window in shown:
        frames = [min(int(share * len(window.transforms)), len(window.transforms) - 1) for share in MOMENTS]
        frames = list(dict.fromkeys(frames))
        body = window.outfit.body
        posed = posed_skin(body, window.transforms[frames])
        colors = [SIMULATION_COLOR, *(method_color(methods, name) for name in list(window.meshes)[1:])]
        images = [
            render(
                [
                    Surface(skin_vertices, body.mesh.faces, BODY_COLOR),
                    Surface(mesh[frame], window.faces, color),
                ],
                three_quarter(skin_vertices),
                PICTURE_SIZE,
            )
            for frame, skin_vertices in zip(frames, posed, strict=True)
            for mesh, color in zip(window.meshes.values(), colors, strict=True)
        ]
        names = ", ".join(window.meshes)
        seconds = ", ".join(f"{frame / window.fps:.1f}" for frame in frames)
        yield Picture(
            f"{window.action}, {window.outfit_name}; from left to right: {names}; "
            f"from top to bottom at {seconds} s",
            png(contact_sheet(images, columns=len(window.meshes))),
        )
        tick()


def png(image: np.ndarray) -> bytes:
    """A picture (h, w, 3) uint8 as PNG bytes, with a palette: a third of the size."""
    from io import BytesIO

    from PIL import Image

    stream = BytesIO()
    Image.fromarray(image).quantize(256).save(stream, "PNG", optimize=True)
    return stream.getvalue()
