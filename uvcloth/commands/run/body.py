"""Bodies of phenotypes, characters and SMPL, as an npz for other commands or as a mesh."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import torch
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from uvcloth.bodies.body import Body, load_body, require_metres, save_body
from uvcloth.bodies.smpl import read_smpl
from uvcloth.bodies.stature import stature
from uvcloth.bodies.visible import visible_body
from uvcloth.characters.body import CharacterBody, body_from_character
from uvcloth.characters.clothes import clothes_of, is_worn_as_skin
from uvcloth.characters.sheet import LEGEND, character_sheet
from uvcloth.commands.body import MakeBody
from uvcloth.errors import InputError
from uvcloth.files.atomic import atomic_write, sole_writer
from uvcloth.files.image import write_png
from uvcloth.geometry.roles import read_role_map
from uvcloth.writers.glb import Document
from uvcloth.writers.gltf_body import add_body
from uvcloth.writers.gltf_scene import add_skeleton
from uvcloth.writers.obj import save_obj


def run(command: MakeBody) -> None:
    """Make the body and write it. Raises InputError for bad input."""
    body = make(command)
    print(f"{command.out}: {len(body.mesh.vertices)} vertices, {len(body.skeleton.names)} joints")


def make(command: MakeBody) -> Body:
    """Make a body and write it to one file, in the format of its suffix.

    It is made from phenotypes, from a character or from an SMPL model (the last two are described), or read
    from a file, or the one in the package. An OBJ or GLB holds the rest pose with its texture coordinates, in
    metres: Z up, facing -Y, or Y up, facing +Z; the GLB also skeleton and skin. Raises InputError as
    `MakeBody.check` does, and for a source that cannot be read or a file that cannot be written.
    """
    command.check()
    out, phenotype = command.out, command.phenotype.given()
    if command.smpl:
        body = replace(_of_smpl(command.smpl, command.betas), name=out.stem)
    elif command.character:
        body = replace(_of_character(command.character, command), name=out.stem)
    elif phenotype:
        from uvcloth.bodies.anny import make_body

        with anny_progress() as progress:
            progress.add_task("making the body", total=None)
            body = make_body(out.stem, phenotype)
    else:
        body = replace(load_body(command.body), name=out.stem)
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


def _of_character(path: Path, command: MakeBody) -> Body:
    roles = {} if command.joints is None else read_role_map(command.joints)
    with Console(stderr=True).status(f"fitting our surface to {path.name}"):
        try:
            made = body_from_character(path, load_body(), roles, command.keep, command.drop, command.unit)
        except InputError as error:
            picture = _draw(path, roles, command)
            raise InputError(f"{error}; {picture} shows what was taken for what ({LEGEND})") from error
    print("\n".join(made.lines()))
    if command.clothes is not None:
        print("\n".join(_take_off(path, made, command.clothes)))
    if made.rigged.guessed:
        print(
            f"the names of the joints do not tell all roles; {_draw(path, roles, command)} shows a guess "
            f"({LEGEND}), --joints corrects it"
        )
    return made.body


def _take_off(path: Path, made: CharacterBody, folder: Path) -> Iterator[str]:
    """Write the clothes of a character into a folder, and report on each, a line each; on none, one line."""
    garments = clothes_of(path, made.parts)
    if not garments:
        known = ", ".join(dict.fromkeys(part.material or part.name for part in made.parts.surface))
        yield f"  nothing is named as clothes, so {folder} is not written; --drop names them: {known}"
        return
    with sole_writer(folder):
        for name, mesh in garments.items():
            save_obj(mesh, folder / f"{name}.obj")
            yield f"{folder / name}.obj: {len(mesh.vertices)} vertices"
    if is_worn_as_skin(made.parts):
        yield "  the character has no skin beneath them, so the body has their shape and shows them as well"


def _draw(path: Path, roles: Mapping[str, str], command: MakeBody) -> Path:
    """Write a picture of a character, as far as it is understood, beside the body; returns its path."""
    picture = command.out.with_name("character.png")
    write_png(picture, character_sheet(path, load_body(), roles, command.keep, command.drop, command.unit))
    return picture


def _of_smpl(path: Path, betas: Sequence[float]) -> Body:
    model = read_smpl(path)
    with Console(stderr=True).status(f"unwrapping {path.name}"):
        body = model.resting().body(torch.tensor(betas))
    require_metres(path, body.mesh.vertices)
    print(f"{path.name}: {model.kind}, {len(model.shapes)} shape parameters, {stature(body):.2f} m tall")
    return body
