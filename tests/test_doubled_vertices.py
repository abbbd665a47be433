"""A garment file whose vertices are doubled at its UV seams does not come apart there."""

from pathlib import Path

import torch

from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_outfit
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import Mesh
from uvcloth.methods.registry import DEFAULT, load_methods
from uvcloth.motion.library import load_clip
from uvcloth.rollouts.rollout import rollout
from uvcloth.writers.gltf_scene import split_seams
from uvcloth.writers.obj import save_obj

FRAMES = 4
"""Frames from the midst of the walk, where the arms swing."""


def test_seams_hold_over_a_rollout(body: Body, tmp_path: Path) -> None:
    template = fit_template("tops", body).mesh
    source, faces, uvs = split_seams(template)
    doubled = len(source) - len(template.vertices)
    assert doubled > 50
    corners = torch.from_numpy(faces)
    split = Mesh(template.vertices[torch.from_numpy(source)], corners, torch.from_numpy(uvs), corners)
    save_obj(split, tmp_path / "split.obj")
    (garment,) = load_outfit([str(tmp_path / "split.obj")], body)
    assert len(garment.mesh.vertices) == len(source)
    transforms = load_clip("walk", body).transforms()[40 : 40 + FRAMES]
    method = load_methods([DEFAULT], body)
    own = torch.from_numpy(source[-doubled:])
    for clear in (False, True):
        *_, frame = rollout(method, Outfit(body, (garment,)), transforms, 30.0, clear)
        (vertices,) = frame.vertices
        assert float((vertices[-doubled:] - vertices[own]).norm(dim=1).max()) < 1e-5
