"""A picture of what was taken for what in a character: meshes coloured by their use, joints over them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.characters.parts import sort_parts
from uvcloth.characters.props import split_props
from uvcloth.characters.reader import Part, read_character
from uvcloth.characters.rig import RiggedCharacter, rig_character
from uvcloth.errors import InputError
from uvcloth.motion.guess import find_roles
from uvcloth.motion.stick_sheet import LEFT, MIDDLE, RIGHT
from uvcloth.rendering.lighting import COARSE
from uvcloth.rendering.render import (
    BODY_COLOR,
    Color,
    Surface,
    contact_sheet,
    draw_line,
    project,
    render,
    three_quarter,
)

SIZE = (420, 560)
"""Pixels of each view, width and height."""

TURNS = (0.0, 90.0, 180.0)
"""Degrees of the views: front, the body's left, back."""

SURFACE, PROP, VISIBLE, LEFT_OUT = (
    (0.86, 0.72, 0.60),
    (0.52, 0.72, 0.48),
    (0.62, 0.72, 0.88),
    (0.90, 0.62, 0.62),
)
LEGEND = (
    "cloth lies on beige; green is worn over it, blue visible only, red left out; left bones blue, right red"
)
"""Meaning of the colours."""

NO_ROLE = (150, 150, 150)
"""Colour of the bone to a joint without a role."""

FROM_Y_UP = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def character_sheet(
    path: Path,
    pattern: Body,
    joints: Mapping[str, str],
    keep: Iterable[str] = (),
    drop: Iterable[str] = (),
    unit: str | None = None,
) -> np.ndarray:
    """Draw a character from the front, the left and the back, as far as it is understood: (h, w, 3) uint8.

    The arguments are those of `body_from_character`. A character that cannot be put on our skeleton is drawn
    as its file has it, Y up, all meshes in one colour. Raises InputError as `read_character` does.
    """
    character = read_character(path)
    try:
        rigged = rig_character(character, joints, pattern, unit)
    except InputError:
        roles, _ = find_roles(character.joints, character.parents, character.heads, joints, character.table)
        surfaces = [
            Surface(part.mesh.vertices @ FROM_Y_UP.T, part.mesh.faces, BODY_COLOR) for part in character.parts
        ]
        return _views(surfaces, character.heads @ FROM_Y_UP.T, character.parents, roles)
    skeleton = rigged.skeleton
    return _views(_surfaces(rigged, keep, drop), skeleton.heads, skeleton.parents, skeleton.roles)


def _surfaces(rigged: RiggedCharacter, keep: Iterable[str], drop: Iterable[str]) -> list[Surface]:
    """The meshes in the colours of their use, all in one where nothing is left for cloth to lie on."""
    try:
        parts = sort_parts(rigged.parts, rigged.skeleton.names, keep, drop)
    except InputError:
        return _colored(rigged.parts, VISIBLE)
    skin, props = split_props(parts.surface, rigged.skeleton)
    return [
        *_colored(skin, SURFACE),
        *_colored(props, PROP),
        *_colored(parts.visible, VISIBLE),
        *_colored(parts.left_out, LEFT_OUT),
    ]


def _colored(parts: Iterable[Part], color: Color) -> list[Surface]:
    return [Surface(part.mesh.vertices, part.mesh.faces, color) for part in parts]


def _views(
    surfaces: Sequence[Surface], heads: Tensor, parents: Sequence[int], roles: Mapping[str, int]
) -> np.ndarray:
    """Views of meshes and of the joints (J, 3) over them, scaled to two metres and standing on the floor."""
    points = torch.cat([surface.vertices for surface in surfaces])
    low, high = points.amin(0), points.amax(0)
    scale = 2.0 / (high - low).amax().clamp(min=1e-9)
    foot = torch.stack([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    placed = [replace(each, vertices=(each.vertices - foot) * scale) for each in surfaces]
    points, heads = (points - foot) * scale, (heads - foot) * scale
    side_of = {joint: role.partition("_")[0] for role, joint in roles.items()}
    pictures = []
    for turn in TURNS:
        camera = three_quarter(points, turn, rise=0.0)
        picture = render(placed, camera, SIZE, quality=COARSE)
        across, down, _ = np.nan_to_num(project(heads.numpy(), camera, SIZE)).round().astype(int).tolist()
        for joint, parent in enumerate(parents):
            if parent >= 0:
                color = {"left": LEFT, "right": RIGHT}.get(side_of.get(joint, ""), MIDDLE)
                color = color if joint in side_of else NO_ROLE
                for shift in (-1, 0, 1):
                    start, end = ((down[each], across[each] + shift) for each in (parent, joint))
                    draw_line(picture, start, end, color)
        pictures.append(picture)
    return contact_sheet(pictures, columns=len(pictures))
