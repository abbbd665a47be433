"""Simulated clips: an outfit that moves with a body over one clip. A garment is an outfit of one."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.geometry.fingerprint import fingerprint

MOTION_TOLERANCE = 1e-3
"""Largest difference of joint transforms, metres or matrix entries, between files of one motion."""

REST_TOLERANCE = 0.002
"""Metres between a simulated garment's rest mesh and a garment on the body within which they are the same."""

OF_GARMENT = (
    *("template", "source", "wrong_side_percent", "inside_percent", "left_percent", "crossing_percent"),
    *("hash", "scored_frames", "packed_error"),
)
"""Metadata of a garment alone; all others are those of its clip."""


@dataclass(frozen=True)
class SimulatedGarment:
    """A garment of a simulated clip.

    vertices: (F, N, 3) metres, world. faces: (M, 3). rest: (N, 3) m at rest on the body's rest pose.
    metadata: JSON values of it alone, see OF_GARMENT: template (whose motion it takes, or null), source
    ("template" or "file"), the measures of `examine`, over other garments wrong_side_percent (by the name of
    each inner one), and from a file the hash of its contents and scored_frames.
    """

    name: str
    vertices: Tensor
    faces: Tensor
    rest: Tensor
    metadata: Mapping[str, Any] = field(default_factory=dict)

    @property
    def template(self) -> str | None:
        """Template whose motion the garment takes; the name where an old file does not say."""
        template = self.metadata.get("template", self.name)
        return None if template is None else str(template)


@dataclass(frozen=True)
class SimulatedClip:
    """An outfit over one clip.

    garments: the innermost first, all of F frames; none where only the motion is known.
    transforms: (F, J, 3, 4) joint transforms of the body, so that its vertices can be recomputed.
    warm_up: number of leading frames that only let the cloth settle and are never scored.
    metadata: JSON values: clip, body, body_hash, engine, versions, settings, seed; of garments that were
    simulated together layers (their names, innermost first); outfit, types (by garment), split, subject and
    action where they are known; captured, where its frames are poses of several clips. wall_seconds is in
    memory alone, as the same input is to give the same file.
    files: name of each file that it was read from -> content hash.
    """

    garments: tuple[SimulatedGarment, ...]
    transforms: Tensor
    fps: float
    warm_up: int
    metadata: Mapping[str, Any]
    files: Mapping[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of the clip."""
        return str(self.metadata["clip"])

    @property
    def outfit(self) -> str:
        """Name of the outfit: its label, or its garments and body."""
        return str(
            self.metadata.get("outfit") or "_".join([*self.layers, str(self.metadata.get("body", ""))])
        )

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of the garments that were simulated together, innermost first."""
        return tuple(self.metadata.get("layers", self.by_name))

    @property
    def split(self) -> str:
        """One of SPLITS, or UNUSED; "" where that is not known."""
        return str(self.metadata.get("split", ""))

    @property
    def subject(self) -> str:
        """The captured person; "" where that is not known."""
        return str(self.metadata.get("subject", ""))

    @property
    def captured(self) -> Mapping[str, str]:
        """The captured clips that its poses are from -> the subject of each, "" where that is not known."""
        return self.metadata.get("captured") or {self.name: self.subject}

    @property
    def action(self) -> str:
        """Action of the body; the clip's name where that is not known."""
        return str(self.metadata.get("action") or self.name)

    @cached_property
    def by_name(self) -> Mapping[str, SimulatedGarment]:
        """The garments by their names."""
        return {garment.name: garment for garment in self.garments}

    @property
    def vertices(self) -> Tensor:
        """Vertices (F, N, 3) of all garments, one after another."""
        vertices = [garment.vertices for garment in self.garments]
        return vertices[0] if len(vertices) == 1 else torch.cat(vertices, dim=1)

    @property
    def scored_frames(self) -> int:
        """Number of frames after the warm-up."""
        return max(len(self.transforms) - self.warm_up, 0)

    def kind(self, garment: str) -> str:
        """Kind of a garment ("trousers"): by its label, otherwise its template or name."""
        kinds = self.metadata.get("types") or {}
        return str(kinds.get(garment) or self.by_name[garment].template or garment)

    def alone(self, garment: str) -> "SimulatedClip":
        """The clip with one of its garments only."""
        return replace(self, garments=(self.by_name[garment],))

    def from_folder(self, name: str) -> "SimulatedClip":
        """The clip with the folder's name before those of its files."""
        return replace(self, files={f"{name}/{file}": content for file, content in self.files.items()})

    def has_motion_of(self, other: "SimulatedClip") -> bool:
        """True if the body moves as in another clip, within MOTION_TOLERANCE, with as many warm-up frames."""
        same = self.transforms.shape == other.transforms.shape and self.warm_up == other.warm_up
        return same and bool((self.transforms - other.transforms).abs().max() <= MOTION_TOLERANCE)

    def labelled(self, **metadata: Any) -> "SimulatedClip":
        """The clip with more metadata."""
        return replace(self, metadata={**self.metadata, **metadata})


def clip_of_garment(
    vertices: Tensor,
    faces: Tensor,
    rest: Tensor,
    transforms: Tensor,
    fps: float,
    warm_up: int,
    metadata: Mapping[str, Any],
) -> SimulatedClip:
    """The clip of one garment. metadata: of both, as its file has them, with the garment's name."""
    of_garment = {key: value for key, value in metadata.items() if key in OF_GARMENT}
    of_clip = {key: value for key, value in metadata.items() if key not in (*OF_GARMENT, "garment")}
    garment = SimulatedGarment(str(metadata["garment"]), vertices, faces, rest, of_garment)
    return SimulatedClip((garment,), transforms, fps, warm_up, of_clip)


def flat_metadata(clip: SimulatedClip, garment: SimulatedGarment) -> dict[str, Any]:
    """Metadata of a garment's file: those of its clip, the garment's name, and its own."""
    return {**clip.metadata, "garment": garment.name, **garment.metadata}


def join_clips(parts: Mapping[Path, SimulatedClip], whole: str) -> SimulatedClip:
    """Join the garments of several files into one clip.

    whole: what the files are parts of, in words. Raises InputError naming the first file whose body moves
    differently from that of the first file.
    """
    (first_path, first), *others = parts.items()
    for path, other in others:
        if not other.has_motion_of(first):
            raise InputError(f"{path}: has another body motion than {first_path.name} of the same {whole}")
    return replace(
        first,
        garments=tuple(garment for part in parts.values() for garment in part.garments),
        files={name: content for part in parts.values() for name, content in part.files.items()},
    )


def content_hash(garment: SimulatedGarment, transforms: Tensor) -> str:
    """SHA-256 over the simulated vertices and the motion: equal input and machine give an equal hash."""
    return fingerprint(garment.vertices.float(), garment.rest.float(), transforms.float())


def count_frames(clips: Iterable[SimulatedClip]) -> int:
    """The number of scored frames of all clips."""
    return sum(clip.scored_frames for clip in clips)
