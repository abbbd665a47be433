"""Data folders as clips: by their motion, for training on templates, or by their outfits."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import torch
from rich.progress import track
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.dataset.bodies import require_joints, sequence_body
from uvcloth.dataset.clip import REST_TOLERANCE, SimulatedClip, join_clips
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.dataset.splits import TRAINING_SPLITS, captured_clips
from uvcloth.errors import InputError
from uvcloth.files.json_file import require_kinds
from uvcloth.garments.fit import make_fitted
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.mesh import Mesh
from uvcloth.motion.index import INDEX, Entry, clip_file, read_index, require_one_split
from uvcloth.motion.library import load_clip
from uvcloth.motion.poses import SPLITS
from uvcloth.physics.fabric import JERSEY, Fabric, fabric_from

BodyClips = tuple[Body, list[SimulatedClip]]
"""A body, and the clips that were simulated on it."""


def read_clips(folders: Sequence[Path], garments: Sequence[str]) -> list[BodyClips]:
    """Read the training and validation clips of some folders, by body, in each folder sorted by name.

    A clip has all garments that a folder holds of its motion, however they were simulated. Without an
    index.csv in a folder all its clips are read, and have no split. Raises InputError naming the file if one
    is damaged, on a body that its folder lacks, or of another motion than its clip's other garments, naming
    the folder if it holds none of the garments, and naming the person who is in two splits, each in another
    folder, and the name that two bodies share.
    """
    if not folders:
        raise InputError("--data: names no folder of sequences")
    pairs = [each for folder in folders for each in _clips_of(Path(folder), garments)]
    source = " ".join(map(str, folders))
    require_one_split(source, captured_clips(clip for _, clip in pairs))
    bodies: dict[str, BodyClips] = {}
    for body, clip in pairs:
        bodies.setdefault(body.identity.shape, (body, []))[1].append(clip)
    names = [body.name for body, _ in bodies.values()]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"--data: two bodies are called {name}, simulate one of them under another name")
    return list(bodies.values())


def read_motions(
    windows: Path, body: Body, splits: Sequence[str] = SPLITS, clips_from: Path | None = None
) -> list[SimulatedClip]:
    """Read the windows of an index as clips without garments: motion for training without simulations.

    clips_from: folder of the motion files, by default that of the index. Raises InputError as
    `read_index`, `clip_file` and `load_clip` do, and for a window that ends after its motion.
    """
    clips = []
    for entry in read_index(windows).values():
        if entry.split in splits:
            path = clip_file(entry, clips_from or windows.parent)
            motion = load_clip(path, body)
            motion.require_frames(entry.start + entry.frames, path)
            transforms = motion.window(entry.start, entry.frames).transforms()
            labels = {
                "clip": entry.clip,
                "body": body.name,
                "body_hash": body.identity.shape,
                **_labels(entry),
            }
            clips.append(SimulatedClip((), transforms, motion.fps, 0, labels))
    return clips


def require_rests(rests: Mapping[str, Tensor], clips: Sequence[SimulatedClip], body: Body) -> None:
    """Raise InputError naming the clip if it was simulated with another garment or on another body.

    rests: by the name of each garment (N, 3) m, its vertices at rest on the body.
    """
    for clip in clips:
        for garment in clip.garments:
            expected = rests[garment.name]
            same = garment.rest.shape == expected.shape
            if not same or (garment.rest - expected).norm(dim=1).max() > REST_TOLERANCE:
                raise InputError(
                    f"{clip.name}_{garment.name}: its rest shape is not that of garment {garment.name} on "
                    f"body {body.name!r}; it was simulated with another garment or body"
                )


def read_outfit_clips(folder: Path, splits: Sequence[str] = SPLITS) -> list[tuple[Outfit, SimulatedClip]]:
    """Read the clips of a folder by outfit and name, each with its outfit on its body.

    A sequence that was not made with --outfits counts as an outfit too, alone or with its layers, in the
    split that the folder's index gives. Raises InputError naming the file if one is damaged, of no split, on
    a body that the folder lacks, or of another motion than the outfit's other garments; and the folder if it
    holds none in these splits.
    """
    by_clip: dict[tuple[str, str], dict[str, tuple[Path, SimulatedClip]]] = {}
    for path, clip in _files_of(folder):
        if not clip.split:
            raise InputError(f"{path}: has no split: the {INDEX} of its folder lacks the clip {clip.name}")
        if clip.split in splits:
            by_clip.setdefault((clip.outfit, clip.name), {})[clip.garments[0].name] = (path, clip)
    if not by_clip:
        raise InputError(f"{folder}: holds no outfit for {' or '.join(splits)}")
    bodies: dict[str, Body] = {}
    outfits: dict[str, Outfit] = {}
    dressed = []
    for name, clip_name in track(sorted(by_clip), "dressing bodies", transient=True):
        parts = _layers(by_clip[name, clip_name])
        clip = join_clips(parts, "outfit")
        body = sequence_body(next(iter(parts)), clip.metadata, bodies)
        if name not in outfits:
            outfits[name] = Outfit(body, tuple(_dress(path, part, body) for path, part in parts.items()))
        dressed.append((outfits[name], clip))
    return dressed


def labelled(clip: SimulatedClip, index: Mapping[str, Entry]) -> SimulatedClip:
    """The clip with the labels of the index; random outfits have their own."""
    entry = index.get(clip.name)
    if entry is None or "outfit" in clip.metadata:
        return clip
    return clip.labelled(**_labels(entry))


def _clips_of(folder: Path, garments: Sequence[str]) -> list[tuple[Body, SimulatedClip]]:
    """The clips of one folder, see `read_clips`."""
    by_clip: dict[str, dict[Path, SimulatedClip]] = {}
    bodies: dict[str, Body] = {}
    on: dict[str, Body] = {}
    indexed = (folder / INDEX).is_file()
    for path, clip in _files_of(folder):
        body = sequence_body(path, clip.metadata, bodies)
        require_joints(path, clip, body)
        if clip.garments[0].name in garments and (not indexed or clip.split in TRAINING_SPLITS):
            by_clip.setdefault(clip.name, {})[path] = clip
            on[clip.name] = body
    if not by_clip:
        raise InputError(f"{folder}: none of its sequences is a training clip of {', '.join(garments)}")
    joined = [(on[name], join_clips(by_clip[name], f"clip {name!r}")) for name in sorted(by_clip)]
    return [(body, clip.from_folder(folder.name)) for body, clip in joined]


def _files_of(folder: Path) -> Iterator[tuple[Path, SimulatedClip]]:
    """Read every sequence of a folder, with the labels that its index adds."""
    paths = sorted(folder.glob("*.npz"))
    if not paths:
        raise InputError(f"{folder}: no sequence (*.npz) made by `uvcloth simulate` in this folder")
    index = read_index(folder / INDEX) if (folder / INDEX).is_file() else {}
    for path in track(paths, "reading sequences", transient=True):
        yield path, labelled(load_simulated(path), index)


def _labels(entry: Entry) -> dict[str, str]:
    """Metadata that an index has of a clip."""
    return {"split": entry.split, "subject": entry.subject, "action": entry.action}


def _layers(parts: dict[str, tuple[Path, SimulatedClip]]) -> dict[Path, SimulatedClip]:
    """The garments of an outfit in order, by file. Raises InputError if one is missing."""
    path, first = next(iter(parts.values()))
    for layer in first.layers:
        if layer not in parts:
            raise InputError(f"{path}: was simulated with {layer}, whose sequence is not in the folder")
    return dict(parts[layer] for layer in first.layers)


def _dress(path: Path, clip: SimulatedClip, body: Body) -> Garment:
    """The garment of a file on its body, of the fabric that it was simulated with."""
    (simulated,) = clip.garments
    mesh = Mesh(simulated.rest, simulated.faces, torch.zeros(1, 2), torch.zeros_like(simulated.faces))
    garment = make_fitted(simulated.name, mesh, body, simulated.metadata.get("template"))[0]
    return replace(garment, fabric=simulated_fabric(clip, str(path)) or JERSEY)


def simulated_fabric(clip: SimulatedClip, where: str) -> Fabric | None:
    """The fabric in the settings of a clip's engine, None where they name none.

    where: origin of the clip, for the error message. Raises InputError for numbers that no fabric has.
    """
    settings = clip.metadata.get("settings", {})
    require_kinds(settings, {"fabric?": {"*": float}}, f"{where}: the settings")
    return fabric_from(settings["fabric"], where) if "fabric" in settings else None
