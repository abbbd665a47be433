"""Preparation from shapes at rest, once per run: correspondences from ray casting, mesh edges."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.geometry.kept import keep_arrays, kept_arrays
from uvcloth.geometry.mesh import unique_edges
from uvcloth.geometry.records import from_arrays, to_arrays
from uvcloth.methods.physxnet.texels import (
    BodyTexels,
    GarmentDecoder,
    TemplateTexels,
    body_texels,
    build_decoder,
    template_texels,
)

PREPARED_FORMAT = "uvcloth-prepared-2"
PREPARED_FILE = "prepared_{}.npz"
"""File, in the folder of a run, of what was prepared for a body of that name."""


@dataclass(frozen=True)
class Correspondences:
    """Correspondences of a body and its templates, by name. edges: (E, 2) int64 mesh edges of each."""

    texels: BodyTexels
    templates: dict[str, TemplateTexels]
    decoders: dict[str, GarmentDecoder]
    edges: dict[str, Tensor]


@dataclass(frozen=True)
class SharedTexels:
    """The U texels that see a template on one body or another.

    pixels: (U,) int64 into the flattened sheet, ascending. slots: per body, (Q,) int64 places of its own Q
    texels among them. visible: (bodies, U) bool.
    """

    pixels: Tensor
    slots: tuple[Tensor, ...]
    visible: Tensor


def share_texels(prepared: Sequence[Correspondences], name: str) -> SharedTexels:
    """Join the texels that see a template on each of several bodies of one layout."""
    pixels_of = [each.templates[name].pixels for each in prepared]
    pixels = torch.cat(pixels_of).unique()
    visible = torch.stack([torch.isin(pixels, each) for each in pixels_of])
    return SharedTexels(pixels, tuple(torch.searchsorted(pixels, each) for each in pixels_of), visible)


def prepare(folder: Path, body: Body, templates: tuple[str, ...], size: int) -> Correspondences:
    """Read what an earlier start of this run prepared for the body, or cast the rays and write that.

    Only the making needs ray casting: a folder that was prepared here can be trained anywhere.
    Raises InputError naming the file if it is damaged.
    """
    content = _content(body, templates, size)
    path = Path(folder) / PREPARED_FILE.format(body.name)
    if path.exists():
        arrays = kept_arrays(path, PREPARED_FORMAT, "the correspondences of a training run")
        if str(arrays["identity"]) == content:
            return _read(arrays, templates)
    prepared = make(body, templates, size)
    arrays = {"identity": np.array(content)}
    arrays |= to_arrays(prepared.texels, "texels")
    for name in templates:
        arrays |= to_arrays(prepared.templates[name], f"template.{name}")
        arrays |= to_arrays(prepared.decoders[name], f"worn.{name}")
        arrays[f"edges.{name}"] = prepared.edges[name].numpy()
    keep_arrays(path, PREPARED_FORMAT, arrays)
    return prepared


def make(body: Body, templates: tuple[str, ...], size: int) -> Correspondences:
    """Fit every template to the body and cast the rays."""
    from uvcloth.garments.templates import fit_template

    texels = body_texels(body, size)
    garments = {name: fit_template(name, body) for name in templates}
    template_maps = {name: template_texels(name, garments[name].mesh, body, texels) for name in templates}
    return Correspondences(
        texels=texels,
        templates=template_maps,
        decoders={name: build_decoder(garments[name], template_maps[name], texels) for name in templates},
        edges={name: unique_edges(garments[name].mesh.faces) for name in templates},
    )


def _content(body: Body, templates: tuple[str, ...], size: int) -> str:
    """A hash of all that correspondences depend on."""
    data = files("uvcloth") / "data"
    shipped = (data / "layout.npz", *(data / "templates" / f"{name}.npz" for name in templates))
    return fingerprint(
        "/".join([body.identity.whole, *templates, str(size)]),
        *(file.read_bytes() for file in shipped),
    )


def _read(arrays: dict[str, np.ndarray], templates: tuple[str, ...]) -> Correspondences:
    """The preparation in a file."""
    return Correspondences(
        texels=from_arrays(BodyTexels, arrays, "texels"),
        templates={name: from_arrays(TemplateTexels, arrays, f"template.{name}") for name in templates},
        decoders={name: from_arrays(GarmentDecoder, arrays, f"worn.{name}") for name in templates},
        edges={name: torch.from_numpy(arrays[f"edges.{name}"]) for name in templates},
    )
