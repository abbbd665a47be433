"""`uvcloth body`: a body as an npz for the other commands, or as a mesh to model on."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from rasterize.atomic import atomic_write
from rasterize.errors import InputError
from uvcloth.bodies.body import Body, load_body, save_body
from uvcloth.export.glb import Document
from uvcloth.export.gltf_scene import add_body, add_skeleton
from uvcloth.export.obj import save_obj

SUFFIXES = (".npz", ".obj", ".glb")


def make(out: Path, phenotype: Mapping[str, float], body_file: Path | None = None) -> Body:
    """Make a body and write it to one file, as its suffix says.

    phenotype: as `make_body` takes it; without any, the body of the file, or the one in the package. An OBJ
    or GLB holds the rest pose with its texture coordinates, in metres: Z up, facing -Y, or Y up, facing +Z;
    the GLB also skeleton and skin. Raises InputError for another suffix or phenotype, for a file and
    phenotypes both, or if the file cannot be written.
    """
    if out.suffix.lower() not in SUFFIXES:
        raise InputError(f"{out}: a body is written as {', '.join(SUFFIXES)}, not '{out.suffix}'")
    if phenotype and body_file is not None:
        raise InputError(f"{body_file}: is a body already, expected phenotypes or a file, not both")
    if phenotype:
        from uvcloth.bodies.anny import make_body

        print("Making the body (the first time Anny builds its rig, which takes minutes) ...", flush=True)
        body = make_body(out.stem, dict(phenotype))
    else:
        body = replace(load_body(body_file), name=out.stem)
    match out.suffix.lower():
        case ".npz":
            save_body(body, out)
        case ".obj":
            save_obj(body.mesh, out)
        case _:
            document = Document()
            skin, _ = add_skeleton(document, body.skeleton)
            add_body(document, body, skin)
            with atomic_write(out) as partial:
                document.write(partial)
    return body
