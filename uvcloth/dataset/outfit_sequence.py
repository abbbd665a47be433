"""Sequences of outfits: several garments that moved together on one body."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import torch
from rich.progress import track
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.dataset.bodies import sequence_body
from uvcloth.dataset.sequence import SimulatedSequence, load_sequence, require_same_motion
from uvcloth.errors import InputError
from uvcloth.files.json_file import require_kinds
from uvcloth.garments.fit import make_fitted
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.mesh import Mesh
from uvcloth.motion.index import INDEX, Entry, read_index
from uvcloth.motion.poses import SPLITS
from uvcloth.physics.fabric import Fabric, fabric_from


@dataclass(frozen=True)
class OutfitSequence:
    """An outfit over one clip, its N vertices those of its garments one after another, the innermost first.

    name: of the outfit. types: what each garment is ("trousers", "dress"). split: one of SPLITS, subject: who
    moves, "" where that is not known. transforms: (F, J, 3, 4) of the body. vertices: (F, N, 3) m, world.
    warm_up: leading frames that are never scored. files: file, from the data folder, -> content hash.
    """

    name: str
    outfit: Outfit
    types: tuple[str, ...]
    clip: str
    subject: str
    split: str
    transforms: Tensor
    vertices: Tensor
    fps: float
    warm_up: int
    files: dict[str, str] = field(default_factory=dict)
    metadata: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def sizes(self) -> list[int]:
        """Vertices of each garment."""
        return [len(garment.mesh.vertices) for garment in self.outfit.garments]


def load_outfit_sequences(folder: Path, splits: Sequence[str] = SPLITS) -> list[OutfitSequence]:
    """Read the outfits that `uvcloth simulate` moved, sorted by name and clip.

    What was not made with --outfits is one too, by itself or with its layers, of the split that the folder's
    index says. Raises InputError naming the file if one is damaged, of no split, on a body that the folder
    lacks, or of another motion than the outfit's other garments; and the folder if it holds none in these
    splits.
    """
    paths = sorted(folder.glob("*.npz"))
    if not paths:
        raise InputError(f"{folder}: no sequence (*.npz) made by `uvcloth simulate` in this folder")
    index = read_index(folder / INDEX) if (folder / INDEX).is_file() else {}
    found: dict[tuple[str, str], dict[str, tuple[Path, SimulatedSequence]]] = {}
    for path in track(paths, "reading sequences", transient=True):
        sequence = _labelled(path, load_sequence(path), index)
        if sequence.metadata.get("split") in splits:
            outfit = str(sequence.metadata["outfit"])
            found.setdefault((outfit, sequence.clip), {})[sequence.garment] = (path, sequence)
    if not found:
        raise InputError(f"{folder}: holds no outfit for {' or '.join(splits)}")
    bodies: dict[str, Body] = {}
    dressed: dict[str, Outfit] = {}
    sequences = []
    for name, clip in track(sorted(found), "dressing bodies", transient=True):
        parts = _layers(found[name, clip])
        path, first = parts[0]
        body = sequence_body(path, first.metadata, bodies)
        if name not in dressed:
            dressed[name] = _outfit(parts, body)
        sequences.append(_join(name, dressed[name], parts))
    return sequences


def _labelled(path: Path, sequence: SimulatedSequence, index: Mapping[str, Entry]) -> SimulatedSequence:
    """The sequence with the labels of an outfit, which by itself, or with its layers, each garment is."""
    if "outfit" in sequence.metadata:
        return sequence
    if sequence.clip not in index:
        raise InputError(f"{path}: has no split: its clip {sequence.clip} is in no {INDEX} of its folder")
    entry = index[sequence.clip]
    labels = {
        "outfit": "_".join([*sequence.layers, str(sequence.metadata.get("body", ""))]),
        "types": {sequence.garment: sequence.template or sequence.garment},
        "split": entry.split,
        "subject": entry.subject,
        "action": entry.action,
    }
    return replace(sequence, metadata={**sequence.metadata, **labels})


def _layers(parts: dict[str, tuple[Path, SimulatedSequence]]) -> list[tuple[Path, SimulatedSequence]]:
    """The garments of an outfit in order. Raises InputError if one is missing or moves otherwise."""
    first_path, first = next(iter(parts.values()))
    for layer in first.layers:
        if layer not in parts:
            raise InputError(f"{first_path}: was simulated with {layer}, whose sequence is not in the folder")
    ordered = [parts[layer] for layer in first.layers]
    require_same_motion(dict([(first_path, first), *ordered]), "outfit")
    return ordered


def _outfit(parts: Iterable[tuple[Path, SimulatedSequence]], body: Body) -> Outfit:
    garments = []
    for path, part in parts:
        mesh = Mesh(part.rest, part.faces, torch.zeros(1, 2), torch.zeros_like(part.faces))
        garment = make_fitted(part.garment, mesh, body, part.metadata.get("template"))[0]
        garments.append(replace(garment, fabric=_fabric(path, part)))
    return Outfit(body, tuple(garments))


def _fabric(path: Path, sequence: SimulatedSequence) -> Fabric:
    """The fabric of a sequence."""
    settings = sequence.metadata.get("settings", {})
    require_kinds(settings, {"fabric?": {"*": float}}, f"{path}: the settings")
    return fabric_from(settings.get("fabric", {}), str(path))


def _join(name: str, outfit: Outfit, parts: Sequence[tuple[Path, SimulatedSequence]]) -> OutfitSequence:
    _, first = parts[0]
    return OutfitSequence(
        name=name,
        outfit=outfit,
        types=tuple(str(part.metadata.get("types", {}).get(part.garment, "")) for _, part in parts),
        clip=first.clip,
        subject=str(first.metadata.get("subject", "")),
        split=str(first.metadata["split"]),
        transforms=first.transforms,
        vertices=torch.cat([part.vertices for _, part in parts], dim=1),
        fps=first.fps,
        warm_up=first.warm_up,
        files={path.name: str(part.metadata.get("hash", "")) for path, part in parts},
        metadata=first.metadata,
    )
