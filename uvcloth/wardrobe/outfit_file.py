"""Outfit files: one JSON that names the body and the pieces, OBJ files beside it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rasterize.atomic import atomic_write
from rasterize.errors import InputError
from uvcloth.bodies.body import load_body
from uvcloth.garments.fit import make_fitted
from uvcloth.garments.garment import Outfit
from uvcloth.garments.meshfile import read_mesh
from uvcloth.geometry.mesh import Mesh
from uvcloth.motion.poses import SPLITS
from uvcloth.wardrobe.designs import Design

VERSION = "uvcloth-outfit-1"


@dataclass(frozen=True)
class PieceFile:
    """One piece: its OBJ (metres, Z up, on the body's rest pose), its design, and its number of vertices."""

    file: Path
    design: Design
    vertices: int


@dataclass(frozen=True)
class OutfitFile:
    """Outfit of one or two pieces, the innermost first.

    body: npz of the body that it is worn on. fabric: numbers of `uvcloth.simulate.fabric.Fabric`. tightness:
    0 loose to 1 tight. even: whether triangles are of about one size. seams: whether vertices are doubled
    along seams. vertex_range: between which its number of vertices was drawn.
    """

    path: Path
    name: str
    split: str
    body: Path
    seed: int
    pieces: tuple[PieceFile, ...]
    fabric_name: str
    fabric: Mapping[str, float]
    tightness: float
    even: bool
    seams: bool
    vertex_range: tuple[int, int]


def outfit_files(folder: Path) -> list[Path]:
    """Paths of the outfits of a folder, by number. Raises InputError if it holds none."""
    found = sorted(Path(folder).glob("o[0-9]*.json"))
    if not found:
        raise InputError(f"{folder}: holds no outfits, make some with `uvcloth outfits`")
    return found


def load_outfit_file(path: Path) -> OutfitFile:
    """Read the description of an outfit.

    Raises InputError naming the file and what is wrong: not readable, another version, a missing or unknown
    value, a number that is not finite, or a piece or body that is not there.
    """
    path = Path(path)
    values = _read(path)
    try:
        found = values["version"]
        if found != VERSION:
            raise InputError(f"{path}: expected version {VERSION}, found {found}")
        pieces = tuple(_piece(path, entry) for entry in values["pieces"])
        outfit = OutfitFile(
            path=path,
            name=str(values["name"]),
            split=str(values["split"]),
            body=path.parent / str(values["body"]),
            seed=int(values["seed"]),
            pieces=pieces,
            fabric_name=str(values["fabric"]["name"]),
            fabric={key: float(value) for key, value in values["fabric"]["parameters"].items()},
            tightness=float(values["tightness"]),
            even=bool(values["even"]),
            seams=bool(values["seams"]),
            vertex_range=(int(values["vertex_range"][0]), int(values["vertex_range"][1])),
        )
    except KeyError as error:
        raise InputError(f"{path}: the outfit lacks {error}") from error
    except (TypeError, ValueError, AttributeError, IndexError) as error:
        raise InputError(f"{path}: not an outfit made by `uvcloth outfits` ({error})") from error
    if outfit.split not in SPLITS:
        raise InputError(f"{path}: split {outfit.split}, expected one of {', '.join(SPLITS)}")
    if not pieces:
        raise InputError(f"{path}: the outfit has no pieces")
    for file in (outfit.body, *(piece.file for piece in pieces)):
        if not file.is_file():
            raise InputError(f"{path}: names {file.name}, which is not there")
    return outfit


def save_outfit_file(outfit: OutfitFile) -> None:
    """Write the description of an outfit, files relative to it. Raises InputError if it cannot be written."""
    folder = outfit.path.parent
    values = {
        "version": VERSION,
        "name": outfit.name,
        "split": outfit.split,
        "body": outfit.body.relative_to(folder).as_posix(),
        "seed": outfit.seed,
        "vertex_range": list(outfit.vertex_range),
        "even": outfit.even,
        "seams": outfit.seams,
        "tightness": outfit.tightness,
        "fabric": {"name": outfit.fabric_name, "parameters": dict(outfit.fabric)},
        "pieces": [
            {
                "file": piece.file.relative_to(folder).as_posix(),
                "type": piece.design.kind,
                "vertices": piece.vertices,
                "parameters": piece.design.parameters(),
            }
            for piece in outfit.pieces
        ],
    }
    with atomic_write(outfit.path) as partial:
        partial.write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")


def load_pieces(outfit: OutfitFile) -> tuple[Mesh, ...]:
    """Meshes of an outfit, the innermost first, float32, on its body's rest pose.

    Raises InputError as `read_mesh` does, and where a file has another number of vertices than it is said to.
    """
    meshes = []
    for piece in outfit.pieces:
        mesh = read_mesh(piece.file)
        if len(mesh.vertices) != piece.vertices:
            raise InputError(
                f"{piece.file}: has {len(mesh.vertices)} vertices, {outfit.path.name} says {piece.vertices}"
            )
        meshes.append(Mesh(mesh.vertices.float(), mesh.faces, mesh.uvs, mesh.face_uvs))
    return tuple(meshes)


def on_body(outfit: OutfitFile) -> Outfit:
    """The outfit on its body, with blend weights; raises InputError as `load_pieces` and `load_body` do."""
    body = load_body(outfit.body)
    garments = tuple(
        make_fitted(piece.file.stem, mesh, body, None)[0]
        for piece, mesh in zip(outfit.pieces, load_pieces(outfit), strict=True)
    )
    return Outfit(body, garments)


def _piece(path: Path, entry: Mapping[str, Any]) -> PieceFile:
    design = Design.of(str(entry["type"]), entry["parameters"], f"{path}: {entry['file']}")
    return PieceFile(path.parent / str(entry["file"]), design, int(entry["vertices"]))


def _read(path: Path) -> dict[str, Any]:
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a readable JSON file ({error})") from error
    if not isinstance(values, dict):
        raise InputError(f"{path}: not an outfit made by `uvcloth outfits`")
    if not _finite(values):
        raise InputError(f"{path}: holds a number that is not finite")
    return values


def _finite(values: Any) -> bool:
    if isinstance(values, dict):
        return all(map(_finite, values.values()))
    if isinstance(values, list):
        return all(map(_finite, values))
    return not isinstance(values, float) or bool(np.isfinite(values))
