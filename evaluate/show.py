"""Animations and rendered pictures of the judged windows for the report."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from uvcloth.bodies.posing import posed_skin
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.mesh import join_meshes
from uvcloth.rendering.render import (
    BODY_COLOR,
    Color,
    Surface,
    contact_sheet,
    filled_size,
    render,
    three_quarter,
)

from .case import outfit_name
from .progress import progress
from .report import Picture
from .viewer import ViewerClip
from .workers import Work

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
        return join_meshes(
            (garment.mesh.vertices, garment.mesh.faces) for garment in self.outfit.garments
        ).faces

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


@dataclass(frozen=True)
class _Row:
    """One moment of a case, the simulation and every method beside each other.

    place: of the moment among those of all cases. size: of each picture. body: (V, 3) m and its faces.
    garments: (N, 3) m, with the faces (M, 3) of all, and their colours.
    """

    place: tuple[int, int]
    size: tuple[int, int]
    body: Tensor
    body_faces: Tensor
    garments: tuple[Tensor, ...]
    faces: Tensor
    colors: tuple[Color, ...]

    def run(self) -> tuple[tuple[int, int], list[np.ndarray]]:
        """Draw it: the place, and a picture (h, w, 3) uint8 of each."""
        skin = Surface(self.body, self.body_faces, BODY_COLOR)
        camera = three_quarter(torch.cat([self.body, self.garments[0]]), aspect=self.size[0] / self.size[1])
        return self.place, [
            render([skin, Surface(each, self.faces, color)], camera, self.size)
            for each, color in zip(self.garments, self.colors, strict=True)
        ]


def pictures(shown: Sequence[Shown], methods: Sequence[str], work: Work) -> list[Picture]:
    """One picture per case: a row per moment, the simulation first, then every method.

    methods: all that were judged on anything, in order. work: draws the rows.
    """
    rows = [row for number, window in enumerate(shown) for row in _rows(number, window, methods)]
    with progress("Pictures", len(rows)) as tick:
        drawn = {}
        for place, images in work(rows):
            drawn[place] = images
            tick()
    sheets = []
    for number, window in enumerate(shown):
        moments = _moments(window)
        images = [image for moment in range(len(moments)) for image in drawn[number, moment]]
        names = ", ".join(window.meshes)
        seconds = ", ".join(f"{frame / window.fps:.1f}" for frame in moments)
        caption = (
            f"{window.action}, {window.outfit_name}; from left to right: {names}; "
            f"from top to bottom at {seconds} s"
        )
        sheets.append(Picture(caption, png(contact_sheet(images, columns=len(window.meshes)))))
    return sheets


def _moments(window: Shown) -> list[int]:
    """Frames that are pictured."""
    frames = [min(int(share * len(window.transforms)), len(window.transforms) - 1) for share in MOMENTS]
    return list(dict.fromkeys(frames))


def _rows(number: int, window: Shown, methods: Sequence[str]) -> Iterator[_Row]:
    """The rows of a case with its number."""
    frames, body = _moments(window), window.outfit.body
    colors = (SIMULATION_COLOR, *(method_color(methods, name) for name in list(window.meshes)[1:]))
    bodies, simulated = posed_skin(body, window.transforms[frames]), next(iter(window.meshes.values()))
    dressed = torch.cat([bodies, simulated[frames]], 1)
    middles = (dressed.amin(1, keepdim=True) + dressed.amax(1, keepdim=True)) / 2
    size = filled_size(dressed - middles, PICTURE_SIZE)
    for moment, (frame, posed) in enumerate(zip(frames, bodies, strict=True)):
        # Copies: a row of a tensor would travel to another process with all of it.
        garments = tuple(mesh[frame].clone() for mesh in window.meshes.values())
        yield _Row((number, moment), size, posed.clone(), body.mesh.faces, garments, window.faces, colors)


def png(image: np.ndarray) -> bytes:
    """A picture (h, w, 3) uint8 as PNG bytes, with a palette: a third of the size."""
    from io import BytesIO

    from PIL import Image

    stream = BytesIO()
    Image.fromarray(image).quantize(256).save(stream, "PNG", optimize=True)
    return stream.getvalue()
