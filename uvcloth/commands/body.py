"""`uvcloth body`: a body of phenotypes, a character or SMPL, as an npz for other commands or as a mesh."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from uvcloth.bodies.body import Body, load_body, require_metres, save_body
from uvcloth.bodies.smpl import read_smpl
from uvcloth.bodies.stature import stature
from uvcloth.bodies.visible import visible_body
from uvcloth.characters.body import body_from_character
from uvcloth.errors import InputError
from uvcloth.export.glb import Document
from uvcloth.export.gltf_scene import add_body, add_skeleton
from uvcloth.export.obj import save_obj
from uvcloth.files.atomic import atomic_write
from uvcloth.motion.roles import read_role_map

SUFFIXES = (".npz", ".obj", ".glb")


@dataclass(frozen=True)
class CharacterFile:
    """A rigged character in a glTF file, and how to read it.

    joints: JSON of roles and joint names. keep, drop: meshes that cloth collides with, and meshes to leave
    out. unit: of its file, None to determine it.
    """

    path: Path
    joints: Path | None = None
    keep: Sequence[str] = ()
    drop: Sequence[str] = ()
    unit: str | None = None


@dataclass(frozen=True)
class SmplFile:
    """A model file of SMPL, SMPL-H or SMPL-X, and the shape parameters of a person."""

    path: Path
    betas: Sequence[float] = ()


def make(
    out: Path,
    phenotype: Mapping[str, float],
    body_file: Path | None = None,
    character: CharacterFile | None = None,
    smpl: SmplFile | None = None,
) -> Body:
    """Make a body and write it to one file, as its suffix says.

    phenotype: as `make_body` takes it; without any, the body of the file, of the character, which is then
    described, or of the SMPL model, or the one in the package. An OBJ
    or GLB holds the rest pose with its texture coordinates, in metres: Z up, facing -Y, or Y up, facing +Z;
    the GLB also skeleton and skin. Raises InputError for another suffix or phenotype, for two sources of the
    body, or if the file cannot be written.
    """
    if out.suffix.lower() not in SUFFIXES:
        raise InputError(f"{out}: a body is written as {', '.join(SUFFIXES)}, not '{out.suffix}'")
    if phenotype and body_file is not None:
        raise InputError(f"{body_file}: is a body already, expected phenotypes or a file, not both")
    if character and (phenotype or body_file is not None):
        raise InputError(
            f"{character.path}: has a shape of its own, expected it without phenotypes or --body"
        )
    if smpl and (phenotype or body_file is not None or character):
        raise InputError(f"{smpl.path}: expected the SMPL model without phenotypes, --body or --character")
    if smpl:
        body = replace(_of_smpl(smpl), name=out.stem)
    elif character:
        body = replace(_of_character(character), name=out.stem)
    elif phenotype:
        from uvcloth.bodies.anny import make_body

        with anny_progress() as progress:
            progress.add_task("making the body", total=None)
            body = make_body(out.stem, dict(phenotype))
    else:
        body = replace(load_body(body_file), name=out.stem)
    match out.suffix.lower():
        case ".npz":
            save_body(body, out)
        case ".obj":
            save_obj(visible_body(body).mesh, out)
        case _:
            document = Document()
            skin, _ = add_skeleton(document, body.skeleton)
            add_body(document, visible_body(body), skin)
            with atomic_write(out) as partial:
                document.write(partial)
    return body


def anny_progress() -> Progress:
    """Progress of making bodies with Anny, after a line that says how long the first one takes."""
    console = Console(stderr=True)
    console.print("Anny's shapes are read once, two to six minutes; later bodies take seconds")
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    return Progress(*columns, console=console)


def _of_character(character: CharacterFile) -> Body:
    chosen = {} if character.joints is None else read_role_map(character.joints)
    console = Console(stderr=True)
    with console.status(f"fitting our surface to {character.path.name}"):
        made = body_from_character(
            character.path, load_body(), chosen, character.keep, character.drop, character.unit
        )
    print("\n".join(made.lines()))
    return made.body


def _of_smpl(smpl: SmplFile) -> Body:
    model = read_smpl(smpl.path)
    with Console(stderr=True).status(f"unwrapping {smpl.path.name}"):
        body = model.resting().body(torch.tensor(smpl.betas))
    require_metres(smpl.path, body.mesh.vertices)
    print(f"{smpl.path.name}: {model.kind}, {len(model.shapes)} shape parameters, {stature(body):.2f} m tall")
    return body
