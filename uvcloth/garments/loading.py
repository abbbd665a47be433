"""Loading of garments by name: a template, or a mesh file that is fitted to the body."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.arrays import NamedMesh
from uvcloth.garments.fit import PLAIN, Fitting, PlacedFile, fit, place_on_body, read_on_body
from uvcloth.garments.garment import Garment
from uvcloth.garments.holds import Hold, held_at
from uvcloth.garments.pieces import pieces, split
from uvcloth.garments.templates import TEMPLATES, fit_template
from uvcloth.garments.tucks import Tuck, worn_order
from uvcloth.garments.untangling import untangle
from uvcloth.physics.fabric import FabricChoice, find_fabrics

AUTO = "auto"
"""Word for the template that a garment covers best, instead of a template's name."""


def load_garment(name: str, body: Body, report: Callable[[str], None] = lambda line: None) -> Garment:
    """Load a garment at rest on a body: the template of that name, or the file at that path as one garment.

    A file's garment is named by the file's stem. report: called with each line of the file's diagnosis.
    Raises InputError as `fit_template` and `fit` do.
    """
    if name in TEMPLATES:
        return fit_template(name, body)
    fitted = fit(_file(name), body)
    for line in fitted.diagnosis.lines():
        report(line)
    return fitted.garment


def load_outfit(
    names: Sequence[str | NamedMesh],
    body: Body,
    report: Callable[[str], None] = lambda line: None,
    templates: Sequence[str] = (),
    how: Fitting = PLAIN,
    fabric: FabricChoice = None,
    tucks: Sequence[Tuck] = (),
    holds: Sequence[Hold] = (),
) -> tuple[Garment, ...]:
    """Load garments worn together, the innermost first; a file or mesh that holds several gives all of them.

    They come to lie over one another, see `untangle`. names: templates, garment files and meshes. tucks: see
    `worn_order`. templates: those whose motion the garments take, one for all names or one for each; none
    or "auto" for the one that each covers best. report: as `load_garment` has it. how: what is known of
    the body that mesh files and meshes were modelled on, see `read_on_body`. fabric: of all names or
    of each, see `find_fabrics`. holds: see `held_at`. Raises InputError as `fit_template`, `fit`,
    `find_fabrics`, `worn_order` and `held_at` do, for unknown templates, and for a number of templates that
    is neither one nor that of the names.
    """
    fabrics = find_fabrics(fabric, len(names))
    if len(templates) not in (0, 1, len(names)):
        raise InputError(
            f"--template: {len(templates)} for {len(names)} garments, expected one, or one for each"
        )
    template_of = [
        templates[min(index, len(templates) - 1)] if templates else AUTO for index in range(len(names))
    ]
    if unknown := [template for template in template_of if template not in (*TEMPLATES, AUTO)]:
        raise InputError(f"--template {unknown[0]}: expected one of {', '.join((*TEMPLATES, AUTO))}")
    loaded: list[Garment] = []
    for name, template, made_of in zip(names, template_of, fabrics, strict=True):
        if isinstance(name, str) and name in TEMPLATES:
            garment = replace(fit_template(name, body), fabric=made_of)
            loaded.append(garment if template == AUTO else replace(garment, template=template))
            continue
        called, placed = _placed(name, body, how)
        parts = split(called, placed.mesh, body, None if template == AUTO else template)
        for line in placed.diagnosis.lines():
            report(line)
        for piece in parts:
            report(f"  {piece.name}: {len(piece.mesh.vertices)} vertices, worn as {piece.template}")
        # What a file hides, all of its pieces hide together.
        parts = replace(parts[0], hides=placed.hides), *parts[1:]
        loaded += (replace(piece, fabric=made_of) for piece in parts)
    worn = untangle(worn_order(loaded, tucks), body)
    for line in worn.lines:
        report(line)
    return held_at(worn.garments, holds, body)


def _placed(source: str | NamedMesh, body: Body, how: Fitting) -> tuple[str, PlacedFile]:
    """Name and mesh of a garment from a file or a mesh."""
    if isinstance(source, NamedMesh):
        return source.name, place_on_body(Path(source.name), source.mesh, body, how)
    path = _file(source)
    return path.stem, read_on_body(path, body, how)


def _file(name: str) -> Path:
    """The garment file of a name. Raises InputError for a name that is neither a file's nor a template's."""
    path = Path(name)
    if not path.suffix and not path.exists():
        raise InputError(
            f"garment {name}: no such template, expected one of {', '.join(TEMPLATES)}, or a garment file"
        )
    return path


def load_garment_for_data(
    name: str, body: Body, report: Callable[[str], None] = lambda line: None
) -> Garment:
    """Load a garment as `load_garment` does, for data files that are named CLIP_GARMENT.

    Raises InputError also for a mesh file whose data would be mistaken for a template's, or that holds
    several garments.
    """
    path = Path(name)
    template = path.stem.rpartition("_")[2].casefold()
    if name not in TEMPLATES and template in TEMPLATES:
        raise InputError(
            f"{path}: its data would be mistaken for those of the template {template}, rename the file"
        )
    garment = load_garment(name, body, report)
    count = 1 if name in TEMPLATES else int(pieces(garment.mesh).max()) + 1
    if count > 1:
        raise InputError(
            f"{path}: holds {count} garments, a simulated sequence has one: `uvcloth fit {path} --out "
            f"{path.stem}.obj` writes each to a separate file, and --layered simulates these together"
        )
    return garment
