"""Samples of CLOTH3D: simulated outfits on bodies of SMPL, each in a folder.

Bertiche et al., "CLOTH3D: Clothed 3D Humans", 2020. The layout is that of the data set's description
(chalearnlap.cvc.uab.cat/dataset/38), of its starter kit and of the program of "DeePSD" by the same authors
(github.com/hbertiche/DeePSD), which also says in which pose and axes the garments rest.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.progress import track
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.smpl import RestingModel, read_smpl
from uvcloth.bodies.smpl_joints import SMPL_JOINTS, STANDING
from uvcloth.dataset.clip import SimulatedClip, SimulatedGarment
from uvcloth.errors import InputError
from uvcloth.files.fields import LONGEST
from uvcloth.formats.matlab import read_matlab
from uvcloth.formats.obj import read_obj
from uvcloth.formats.size import refuse_large_file
from uvcloth.garments.attach import DIFFUSION, make_garment
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.geometry.mesh import Mesh, edge_lengths, unique_edges
from uvcloth.geometry.rotations import from_axis_angles, from_euler
from uvcloth.geometry.skeleton import joint_transforms, world_rotations
from uvcloth.motion.clip_splits import deal_splits
from uvcloth.motion.poses import SPLITS
from uvcloth.physics.fabric import FABRICS, JERSEY, Fabric

INFO = "info.mat"

FPS = 30.0
"""Frames per second of the data set; its files do not say."""

MOST_METRES, MOST_SETTING = 1.0e4, 100.0
"""Limits for the numbers of a file: metres or radians of a frame, and all others, such as shape parameters.
"""

LEAST_EDGE = 0.001
"""Least mean edge length of a garment, m: weights spread from vertex to vertex."""

REST_SPREAD = 0.15
"""Radians that each hip is turned outwards in the pose in which garments rest, arms as in the zero pose."""

GENDERS = ("female", "male")
"""Genders by their number in the files."""

TEMPLATES = {
    "Trousers": "bottoms",
    "Skirt": "dress",
    "Jumpsuit": "bottoms",
    "Dress": "dress",
    "Top": "tops",
    "Tshirt": "tops",
    "Shirt": "shirt",
}
"""Garments of the data set, the innermost first, and the template whose motion each takes."""

LABELS = FABRICS | {"leather": Fabric(density=0.6, stretch=200.0, bend=3e-4, friction=0.5)}
"""Fabrics that the data set names; leather has rough values of thin clothing leather."""

CACHES: dict[str, np.dtype] = {".pc16": np.dtype("<f2"), ".pc2": np.dtype("<f4")}
"""Kinds of point caches and the floats that each holds, the usual one first."""

HEADER = struct.Struct("<12siiffi")
SIGNATURE = b"POINTCACHE2\0"

MODELS = "smpl"
"""Folder, beside the samples, of the model files: model_f and model_m, .npz or .pkl."""

EVERY = 10
"""One of this many frames is read: neighbours add little to training, and thousands of samples fill memory.
"""

SPLIT_FOLDERS = {"train": "train", "val": "validation", "validation": "validation", "test": "test"}


def is_cloth3d(root: Path) -> bool:
    """Test for a folder that holds samples."""
    return bool(_folders(root))


def load_cloth3d(
    root: Path, splits: Sequence[str] = SPLITS, every: int = EVERY
) -> list[tuple[Outfit, SimulatedClip]]:
    """Read the samples of a folder in some splits, on the models in its folder smpl, one frame of `every`.

    Raises InputError as `cloth3d_samples` and `read_cloth3d_sample` do, and if the folder lacks both models.
    """
    models = {
        gender: path
        for gender in GENDERS
        for suffix in (".npz", ".pkl")
        if (path := root / MODELS / f"model_{gender[0]}{suffix}").is_file()
    }
    if not models:
        raise InputError(f"{root}: lacks {MODELS}/model_f and model_m (.npz or .pkl), the models of SMPL")
    samples = [(folder, split) for folder, split in cloth3d_samples(root).items() if split in splits]
    return [
        read_cloth3d_sample(folder, models, split, every)
        for folder, split in track(samples, "reading samples", transient=True)
    ]


def cloth3d_samples(root: Path) -> dict[Path, str]:
    """Find the samples of a folder, sorted, and the split of each.

    A sample is a folder with an info.mat, in the root or a folder in it; one named train, val or test gives
    the split. Other samples are dealt out, those of one person (01_05_s1 is of the person 01) together.
    Raises InputError if there are none.
    """
    folders = _folders(root)
    if not folders:
        raise InputError(f"{root}: holds no sample of CLOTH3D, a folder with {INFO} and garments")
    dealt = deal_splits({_subject(folder) for folder in folders})
    return {folder: SPLIT_FOLDERS.get(folder.parent.name, dealt[_subject(folder)]) for folder in folders}


def read_cloth3d_sample(
    folder: Path, smpl: Mapping[str, Path], split: str = "train", every: int = 1
) -> tuple[Outfit, SimulatedClip]:
    """Read a sample: its person as a body of SMPL, its garments, and their motion.

    folder: with info.mat, and for each garment NAME.obj and NAME.pc16. smpl: model files of SMPL by gender,
    female and male. every: read one of this many frames. The body rests in the pose in which the garments do,
    with its pelvis at the origin. Vertices of a cache are known to 1 mm within 2 m of the pelvis. Raises
    InputError naming the file and the part that is missing, damaged, or does not fit the others.
    """
    info = _info(folder)
    poses, trans = (_frames(folder, info, name, size) for name, size in (("poses", 72), ("trans", 3)))
    if len(poses) != len(trans):
        raise InputError(f"{folder / INFO}: has {len(poses)} poses and {len(trans)} root positions (trans)")
    body, gender = _body(folder, info, smpl)
    upright = from_euler("z", torch.tensor([_number(folder, info, "zrot")]))
    pieces = _pieces(folder, info)
    labels = {name: _fabric(folder, name, piece) for name, piece in pieces.items()}
    garments = tuple(
        replace(_garment(folder, name, body, upright), fabric=LABELS.get(label.lower(), JERSEY))
        for name, label in labels.items()
    )
    transforms = _transforms(body, poses[::every], trans[::every], upright)
    files = {f"{folder.name}/{INFO}": fingerprint((folder / INFO).read_bytes())}
    simulated = []
    for garment in garments:
        cache_file, vertices = _cache(folder, garment, len(poses), every)
        files[f"{folder.name}/{cache_file.name}"] = fingerprint(vertices)
        vertices = (vertices + trans[::every, None]) @ upright.T
        mesh, takes = garment.mesh, {"template": garment.template}
        simulated.append(SimulatedGarment(garment.name, vertices, mesh.faces, mesh.vertices, takes))
    metadata = {
        "clip": folder.name,
        "outfit": folder.name,
        "types": {name: name.lower() for name in pieces},
        "subject": _subject(folder),
        "split": split,
        "source": "CLOTH3D",
        "gender": gender,
        "shape": _array(folder, info, "shape").tolist(),
        "tightness": np.atleast_1d(_array(folder, info, "tightness")).tolist() if "tightness" in info else [],
        "fabric": labels,
    }
    return Outfit(body, garments), SimulatedClip(
        tuple(simulated), transforms, FPS / every, 0, metadata, files
    )


def _folders(root: Path) -> list[Path]:
    return sorted(info.parent for pattern in (f"*/{INFO}", f"*/*/{INFO}") for info in root.glob(pattern))


def _subject(folder: Path) -> str:
    """Person of a sample: the first of three numbers, as in 01_05_s1; in any other name the whole name."""
    parts = folder.name.split("_")
    return parts[0] if len(parts) == 3 else folder.name


def _info(folder: Path) -> dict[str, Any]:
    if not (folder / INFO).is_file():
        raise InputError(f"{folder}: lacks {INFO}, so it is not a sample of CLOTH3D")
    return read_matlab(folder / INFO)


def _array(folder: Path, info: Mapping[str, Any], name: str, most: float = MOST_SETTING) -> np.ndarray:
    """Numbers of a file, none of them beyond `most`."""
    if name not in info:
        raise InputError(f"{folder / INFO}: lacks {name}")
    values = info[name]
    if not isinstance(values, np.ndarray):
        raise InputError(f"{folder / INFO}: {name} holds no numbers")
    values = values.astype(np.float64)
    if not np.isfinite(values).all():
        raise InputError(f"{folder / INFO}: {name} holds a value that is not a finite number")
    if (np.abs(values) > most).any():
        raise InputError(f"{folder / INFO}: {name} holds a value beyond {most:g}")
    return values


def _frames(folder: Path, info: Mapping[str, Any], name: str, size: int) -> Tensor:
    """Values (F, size) of the frames; a file of one frame has no axis for them."""
    values = _array(folder, info, name, MOST_METRES)
    if values.ndim == 1:
        values = values[:, None]
    if values.ndim != 2 or len(values) != size or values.shape[1] == 0:
        raise InputError(f"{folder / INFO}: {name} has the shape {values.shape}, expected ({size}, frames)")
    return torch.from_numpy(values.T.astype(np.float32))


def _number(folder: Path, info: Mapping[str, Any], name: str) -> float:
    values = _array(folder, info, name)
    if values.size != 1:
        raise InputError(f"{folder / INFO}: {name} has the shape {values.shape}, expected one number")
    return float(values.item())


@cache
def _model(path: Path) -> RestingModel:
    """A model of SMPL in the rest pose of the garments; all its bodies share the pose corrections."""
    model = read_smpl(path)
    if model.kind != "SMPL":
        raise InputError(f"{path}: is a model of {model.kind}, but CLOTH3D uses SMPL")
    return model.resting(_rest_pose())


def _body(folder: Path, info: Mapping[str, Any], smpl: Mapping[str, Path]) -> tuple[Body, str]:
    """The person at rest as garments do, the pelvis at the origin, and the gender."""
    number = _number(folder, info, "gender")
    if number not in (0.0, 1.0):
        raise InputError(f"{folder / INFO}: gender is {number:g}, expected 0 (female) or 1 (male)")
    gender = GENDERS[int(number)]
    if gender not in smpl:
        raise InputError(f"{folder}: the person is {gender}, but the {gender} model of SMPL is missing")
    model = _model(Path(smpl[gender]))
    shape = torch.from_numpy(_array(folder, info, "shape").reshape(-1))
    try:
        body = model.body(shape, unwrapped=False)
    except InputError as error:
        raise InputError(f"{folder / INFO}: shape: {error}") from error
    pelvis = body.skeleton.heads[0]
    skeleton = replace(body.skeleton, heads=body.skeleton.heads - pelvis)
    mesh = replace(body.mesh, vertices=body.mesh.vertices - pelvis)
    return replace(body, name=folder.name, mesh=mesh, skeleton=skeleton), gender


def _rest_pose() -> Tensor:
    """Axis-angles (24, 3), relative to the parents, of the pose in which garments rest."""
    rest = torch.zeros(len(SMPL_JOINTS["SMPL"]), 3)
    rest[1, 2], rest[2, 2] = REST_SPREAD, -REST_SPREAD
    return rest


def _pieces(folder: Path, info: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Entries of the file for each garment, the innermost first."""
    outfit = info.get("outfit")
    if (
        not isinstance(outfit, dict)
        or not outfit
        or not all(isinstance(each, dict) for each in outfit.values())
    ):
        raise InputError(f"{folder / INFO}: lacks the outfit, a struct for each garment")
    order = list(TEMPLATES)
    return {
        name: outfit[name]
        for name in sorted(outfit, key=lambda name: order.index(name) if name in order else len(order))
    }


def _fabric(folder: Path, name: str, piece: Mapping[str, Any]) -> str:
    """Fabric of a garment; "" where the file does not say."""
    fabric = piece.get("fabric", "")
    if not isinstance(fabric, str) or not fabric.isprintable() or len(fabric) > LONGEST:
        raise InputError(f"{folder / INFO}: the fabric of the {name} is not printable text")
    return fabric


def _garment(folder: Path, name: str, body: Body, upright: Tensor) -> Garment:
    path = folder / f"{name}.obj"
    if not path.is_file():
        raise InputError(f"{folder}: lacks {path.name}, the {name} at rest")
    refuse_large_file(path)
    read = read_obj(path)
    if not len(read.vertices) or not len(read.faces):
        raise InputError(f"{path}: has no faces")
    if not (read.vertices.abs() <= MOST_METRES).all():
        raise InputError(f"{path}: a vertex is not a finite number, or beyond {MOST_METRES:g} m")
    edge = float(edge_lengths(read.vertices, unique_edges(read.faces)).mean())
    if edge < LEAST_EDGE:
        raise InputError(
            f"{path}: its edges are {1000 * edge:.2g} mm long on average, expected a garment in metres"
        )
    # The garments at rest are turned by zrot, the motion is not.
    mesh = Mesh(read.vertices.float() @ upright, read.faces, read.uvs, read.face_uvs)
    template = TEMPLATES.get(name)
    return make_garment(name, mesh, body, DIFFUSION[template or "tops"], template=template)


def _cache(folder: Path, garment: Garment, frames: int, every: int) -> tuple[Path, Tensor]:
    """The point cache of a garment, and its vertices (F, N, 3) m from the pelvis."""
    path = next((path for suffix in CACHES if (path := folder / f"{garment.name}{suffix}").is_file()), None)
    if path is None:
        raise InputError(f"{folder}: lacks {garment.name}.pc16, the motion of the {garment.name}")
    kind, size = CACHES[path.suffix], path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(HEADER.size)
    if len(head) < HEADER.size or not head.startswith(SIGNATURE):
        raise InputError(f"{path}: not a point cache, it does not begin with POINTCACHE2")
    _, _, points, _, _, samples = HEADER.unpack(head)
    if points != len(garment.mesh.vertices):
        raise InputError(
            f"{path}: has {points} vertices, but {garment.name}.obj has {len(garment.mesh.vertices)}"
        )
    if samples != frames:
        raise InputError(f"{path}: has {samples} frames, but {INFO} has {frames}")
    if size != HEADER.size + samples * points * 3 * kind.itemsize:
        whole = (size - HEADER.size) // (points * 3 * kind.itemsize)
        raise InputError(f"{path}: its header gives {samples} frames, but the file has {whole} complete ones")
    stored = np.memmap(path, kind, "r", HEADER.size, (samples, points, 3))
    vertices = torch.from_numpy(stored[::every].astype(np.float32))
    far = ~(vertices.abs() <= MOST_METRES).flatten(1).all(1)
    if far.any():
        raise InputError(
            f"{path}: a vertex of frame {int(far.int().argmax()) * every} is not a finite number, "
            f"or beyond {MOST_METRES:g} m"
        )
    return path, vertices


def _transforms(body: Body, poses: Tensor, trans: Tensor, upright: Tensor) -> Tensor:
    """Joint transforms (F, J, 3, 4) from the rest pose of the body, in the world."""
    parents = body.skeleton.parents
    local = from_axis_angles(poses.unflatten(1, (-1, 3)))
    rest = _rest_pose()
    rest[0] = torch.tensor(STANDING)
    resting = world_rotations(parents, from_axis_angles(rest)[None])
    rotations = upright @ world_rotations(parents, local) @ resting.mT
    return joint_transforms(body.skeleton, rotations, trans @ upright.T)
