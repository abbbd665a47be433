"""Cases: an outfit over a clip, garments that were simulated together, with references to score against."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin
from uvcloth.dataset.bodies import require_joints
from uvcloth.dataset.clip import REST_TOLERANCE, SimulatedClip, SimulatedGarment
from uvcloth.dataset.clip_file import load_simulated, read_metadata
from uvcloth.dataset.folder import MEMBERS, is_finished, member_folder
from uvcloth.dataset.reader import simulated_fabric
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.mesh import Mesh, join_meshes
from uvcloth.geometry.skinning import skin

from .actions import Window
from .body_scores import DressedBody, dressed_body
from .looks import Looks, prepare_looks
from .maps import Texels
from .metrics import Reference

SHOWN = 50
"""Most frames of a case that are kept for the viewer and the pictures."""


@dataclass(frozen=True)
class ScoredPart:
    """A unit of scoring: a garment of an outfit, or the whole outfit as one mesh.

    rows: its vertices among those of the outfit. meshes: of its garments at rest. reference: the scored
    frames.
    """

    name: str
    rows: slice
    meshes: tuple[Mesh, ...]
    reference: Reference


@dataclass(frozen=True)
class Case:
    """An outfit over a clip; a garment that was simulated alone is an outfit of one.

    windows: of its garments, the innermost first. clip: the simulation. members: the other members of its
    ensemble, if there are any. parts: units of scoring, each garment and last, if there are several, the
    whole outfit. start: number of warm-up frames. transforms: (F, J, 3, 4) and body_vertices: (F, V, 3) of
    the body in the scored frames. turned: True if its scene is also rolled out turned.
    """

    windows: tuple[Window, ...]
    clip: SimulatedClip
    members: tuple[SimulatedClip, ...]
    outfit: Outfit
    parts: tuple[ScoredPart, ...]
    start: int
    transforms: Tensor
    body_vertices: Tensor
    turned: bool = True

    @property
    def name(self) -> str:
        """Clip and garments, the stem of its file."""
        return "_".join([self.windows[0].clip, *(window.garment for window in self.windows)])

    @property
    def action(self) -> str:
        """The action of the clip."""
        return self.windows[0].action

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self.clip.fps

    @property
    def motion(self) -> Tensor:
        """Joint transforms (T, J, 3, 4) of all frames, warm-up included."""
        return self.clip.transforms[: self.end]

    @property
    def truth(self) -> Tensor:
        """All vertices of the simulated outfit in the scored frames (F, N, 3), m."""
        return self.parts[-1].reference.vertices

    @cached_property
    def dressed(self) -> dict[str, DressedBody]:
        """The garments of each part as they lie on the body, by its name; for all methods and settings."""
        return {part.name: dressed_body(self.outfit.body, part.meshes) for part in self.parts}

    @cached_property
    def looks(self) -> dict[str, Looks]:
        """The garments of each part prepared for measures of looks, by its name."""
        known = simulated_fabric(self.clip, self.name)
        fabrics = {garment.name: known or garment.fabric for garment in self.outfit.garments}
        return {part.name: prepare_looks(part.reference, fabrics.get(part.name)) for part in self.parts}

    @property
    def end(self) -> int:
        """The frame of the clip after the last scored one."""
        return self.start + len(self.transforms)

    @property
    def stride(self) -> int:
        """Number of frames from one that is shown to the next."""
        return -(-len(self.transforms) // SHOWN)


def outfit_name(garments: Sequence[str]) -> str:
    """The name of an outfit in every table, from its garments, the innermost first: "tops over bottoms"."""
    return " over ".join(reversed(garments))


def simulated_together(windows: Sequence[Window]) -> tuple[tuple[Window, ...], ...]:
    """Windows by outfit, the garments that were simulated together, the innermost first, in their own order.

    Raises InputError for a window that lacks the sequence of a garment it was simulated with.
    """
    known = {(window.clip, window.garment): window for window in windows}
    outfits: dict[tuple[Window, ...], None] = {}
    for window in windows:
        layers = read_metadata(window.path).get("layers", [window.garment])
        for name in layers:
            if (window.clip, name) not in known:
                raise InputError(
                    f"{window.path}: was simulated with the garment {name}, which has no sequence here; "
                    "name the file of a garment with --garment"
                )
        outfits[tuple(known[window.clip, name] for name in layers)] = None
    return tuple(outfits)


def open_case(
    windows: tuple[Window, ...],
    outfit: Outfit,
    texels: Mapping[str, Texels | None],
    frames: int | None,
    turned: bool = True,
) -> Case:
    """Load sequences that were simulated together, and check that they are of these garments on this body.

    texels: of each garment's map by its name, None without one. frames: score at most so many, None for all.
    turned: as of a `Case`. Raises InputError naming the file if a mesh, a rest shape, the skeleton or the
    motion of an ensemble member differs, a member is missing, or garments do not move with the same body.
    """
    paths = [window.path for window in windows]
    clip = _load(paths, outfit)
    members = []
    for files in _member_files(paths):
        members.append(_load(files, outfit))
        if not members[-1].has_motion_of(clip):
            raise InputError(f"{files[0]}: has another motion than {paths[0]}, whose ensemble it is in")
    return make_case(windows, clip, outfit, texels, frames, members, turned)


def _member_files(paths: Sequence[Path]) -> list[list[Path]]:
    """The files of the other members of an ensemble, one of each garment; refused members are left out.

    Raises InputError naming a file that is missing while other files of its member and of the ensemble are
    there.
    """
    folders = [member_folder(paths[0].parent, member) for member in range(1, MEMBERS)]
    files = [[folder / path.name for path in paths] for folder in folders if folder.is_dir()]
    lacking = [path for member in files for path in member if not is_finished(path)]
    if 0 < len(lacking) < sum(map(len, files)):
        raise InputError(
            f"{lacking[0]}: is missing, while others of this ensemble are there: simulate it too"
        )
    return [member for member in files if all(map(Path.is_file, member))]


def _load(paths: Sequence[Path], outfit: Outfit) -> SimulatedClip:
    """The clip of the files of an outfit's garments. Raises InputError naming the file that does not fit."""
    clip = load_simulated(*paths)
    for path, garment, simulated in zip(paths, outfit.garments, clip.garments, strict=True):
        _require_same(path, clip, simulated, garment, outfit.body)
    return clip


def make_case(
    windows: tuple[Window, ...],
    clip: SimulatedClip,
    outfit: Outfit,
    texels: Mapping[str, Texels | None],
    frames: int | None = None,
    members: Sequence[SimulatedClip] = (),
    turned: bool = True,
) -> Case:
    """The case of a clip whose garments are those of the outfit; see `open_case`.

    members: other simulations of the clip and its garments. turned: as of a `Case`.
    """
    scored = slice(clip.warm_up, None if frames is None else clip.warm_up + frames)
    parts: list[ScoredPart] = []
    row = 0
    transforms = clip.transforms[scored]
    for index, (garment, simulated) in enumerate(zip(outfit.garments, clip.garments, strict=True)):
        map_texels = texels.get(garment.name)
        reference = Reference(
            simulated.vertices[scored],
            tuple(member.garments[index].vertices[scored] for member in members),
            skin(garment.mesh.vertices, garment.smooth_weights, transforms),
            simulated.rest,
            simulated.faces,
            clip.fps,
            *(map_texels or (None, None)),
        )
        rows = slice(row, row + len(simulated.rest))
        parts.append(ScoredPart(garment.name, rows, (garment.mesh,), reference))
        row = rows.stop
    if len(parts) > 1:
        parts.append(_whole(parts, row))
    posed = posed_skin(outfit.body, transforms)
    return Case(windows, clip, tuple(members), outfit, tuple(parts), clip.warm_up, transforms, posed, turned)


def _whole(parts: Sequence[ScoredPart], vertices: int) -> ScoredPart:
    """The garments of an outfit as one mesh, which has no map."""
    joined = join_meshes((part.reference.rest, part.reference.faces) for part in parts)
    references = [part.reference for part in parts]
    members = zip(*(each.members for each in references), strict=True)
    reference = Reference(
        vertices=torch.cat([each.vertices for each in references], dim=1),
        members=tuple(torch.cat(member, dim=1) for member in members),
        skinned=torch.cat([each.skinned for each in references], dim=1),
        rest=joined.vertices,
        faces=joined.faces,
        fps=parts[0].reference.fps,
        texel_corners=None,
        texel_barycentrics=None,
    )
    meshes = tuple(mesh for part in parts for mesh in part.meshes)
    return ScoredPart(outfit_name([part.name for part in parts]), slice(0, vertices), meshes, reference)


def _require_same(
    path: Path, clip: SimulatedClip, simulated: SimulatedGarment, garment: Garment, body: Body
) -> None:
    """Raise InputError naming the file if it was not simulated with this garment on this body."""
    mesh = garment.mesh
    if not torch.equal(simulated.faces, mesh.faces):
        raise InputError(f"{path}: its mesh is not that of the garment {garment.name}")
    require_joints(path, clip, body)
    apart = float((simulated.rest - mesh.vertices).norm(dim=1).max())
    if apart > REST_TOLERANCE:
        raise InputError(
            f"{path}: at rest it is up to {1000 * apart:.0f} mm from the garment {garment.name} "
            f"on body {body.name!r}; it was simulated in another shape or on another body"
        )
