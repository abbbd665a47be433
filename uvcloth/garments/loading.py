"""Loading of garments by name: a template, or a mesh file that is fitted to the body."""

from collections.abc import Callable
from pathlib import Path

from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.garments.fit import fit
from uvcloth.garments.garment import Garment
from uvcloth.garments.templates import TEMPLATES, fit_template


def load_garment(name: str, body: Body, report: Callable[[str], None] = lambda line: None) -> Garment:
    """Load a garment at rest on a body: the template of that name, or the mesh file at that path.

    A file's garment is named by the file's stem. report: called with each line of the file's diagnosis.
    Raises InputError as `fit_template` and `fit` do.
    """
    if name in TEMPLATES:
        return fit_template(name, body)
    fitted = fit(Path(name), body)
    for line in fitted.diagnosis.lines():
        report(line)
    return fitted.garment


def load_garment_for_data(
    name: str, body: Body, report: Callable[[str], None] = lambda line: None
) -> Garment:
    """Load a garment as `load_garment` does, where data files will be named CLIP_GARMENT by it.

    Raises InputError also for a mesh file whose data would be mistaken for a template's.
    """
    path = Path(name)
    template = path.stem.rpartition("_")[2]
    if name not in TEMPLATES and template in TEMPLATES:
        raise InputError(
            f"{path}: its data would be mistaken for those of the template {template}, rename the file"
        )
    return load_garment(name, body, report)
