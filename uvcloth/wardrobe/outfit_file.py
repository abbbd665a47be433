"""Outfit files: one JSON that names the body and the pieces, OBJ files beside it."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from uvcloth.bodies.body import load_body
from uvcloth.errors import InputError
from uvcloth.files.atomic import atomic_write
from uvcloth.files.fields import is_file_name
from uvcloth.files.json_file import read_json, require_kinds
from uvcloth.files.reading import file_below
from uvcloth.formats.mesh_file import read_mesh
from uvcloth.garments.fit import make_fitted
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.mesh import Mesh
from uvcloth.motion.poses import SPLITS
from uvcloth.physics.fabric import Fabric, fabric_from
from uvcloth.wardrobe.designs import Design

VERSION = "uvcloth-outfit-1"
KINDS = {
    "version": str,
    "name": str,
    "split": str,
    "body": str,
    "seed": int,
    "pieces": [{"file": str, "type": str, "vertices": int, "parameters": {"*": {"*": float}}}],
    "fabric": {"name": str, "parameters": {"*": float}},
    "tightness": float,
    "even": bool,
    "seams": bool,
    "vertex_range": [int],
}
"""Kinds of the values of a file."""

MOST_VERTICES = 1_000_000
"""Limit for the vertices of a piece, and for the range that their number was drawn from."""


@dataclass(frozen=True)
class PieceFile:
    """One piece: its OBJ (metres, Z up, on the body's rest pose), its design, and its number of vertices."""

    file: Path
    design: Design
    vertices: int


@dataclass(frozen=True)
class OutfitFile:
    """Outfit of one or two pieces, the innermost first.

    body: npz of the body that it is worn on. tightness: 0 loose to 1 tight. even: whether triangles are of
    about one size. seams: whether vertices are doubled along seams. vertex_range: limits between which its
    number of vertices was drawn.
    """

    path: Path
    name: str
    split: str
    body: Path
    seed: int
    pieces: tuple[PieceFile, ...]
    fabric_name: str
    fabric: Fabric
    tightness: float
    even: bool
    seams: bool
    vertex_range: tuple[int, int]


def outfit_files(folder: Path) -> list[Path]:
    """Paths of the outfits of a folder, by number. Raises InputError if it holds none."""
    paths = sorted(Path(folder).glob("o[0-9]*.json"))
    if not paths:
        raise InputError(f"{folder}: holds no outfits, make some with `uvcloth outfits`")
    return paths


def load_outfit_file(path: Path) -> OutfitFile:
    """Read the description of an outfit.

    Raises InputError naming the file and what is wrong: not readable, another version, a missing or unknown
    value, a number that is not finite, or a piece or body that does not exist.
    """
    path = Path(path)
    values = read_json(path, "an outfit made by `uvcloth outfits`")
    if values.get("version") != VERSION:
        raise InputError(f"{path}: expected version {VERSION}, found {values.get('version')!s:.40}")
    require_kinds(values, KINDS, f"{path}: the outfit")
    _require_ranges(path, values)
    least, most = values["vertex_range"]
    return OutfitFile(
        path=path,
        name=values["name"],
        split=values["split"],
        body=_file(path, values["body"]),
        seed=values["seed"],
        pieces=tuple(_piece(path, entry) for entry in values["pieces"]),
        fabric_name=values["fabric"]["name"],
        fabric=fabric_from(values["fabric"]["parameters"], str(path)),
        tightness=float(values["tightness"]),
        even=values["even"],
        seams=values["seams"],
        vertex_range=(least, most),
    )


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
        "fabric": {"name": outfit.fabric_name, "parameters": asdict(outfit.fabric)},
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

    Raises InputError as `read_mesh` does, and for a file with more or fewer vertices than its outfit says.
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
    design = Design.of(entry["type"], entry["parameters"], f"{path}: {entry['file']!s:.100}")
    return PieceFile(_file(path, entry["file"]), design, entry["vertices"])


def _file(path: Path, name: str) -> Path:
    """A file that an outfit names, in its folder. Raises InputError if it is not there or elsewhere."""
    try:
        file = file_below(path.parent, path.parent, name)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    if not file.is_file():
        raise InputError(f"{path}: names {file.name}, which does not exist")
    return file


def _require_ranges(path: Path, values: Mapping[str, Any]) -> None:
    """Raise InputError for a value of the right kind that no outfit has."""
    if values["split"] not in SPLITS:
        raise InputError(f"{path}: split {values['split']!r:.40}, expected one of {', '.join(SPLITS)}")
    if not values["pieces"]:
        raise InputError(f"{path}: the outfit has no pieces")
    for name in (values["name"], values["fabric"]["name"]):
        if not is_file_name(name):
            raise InputError(f"{path}: {name!r:.40} cannot be part of a file's name")
    if not 0.0 <= values["tightness"] <= 1.0:
        raise InputError(f"{path}: tightness is {values['tightness']}, expected 0 to 1")
    bounds = values["vertex_range"]
    if len(bounds) != 2 or not 0 < bounds[0] <= bounds[1] <= MOST_VERTICES:
        raise InputError(
            f"{path}: vertex_range is {bounds!s:.40}, expected two numbers from 1 to {MOST_VERTICES}"
        )
