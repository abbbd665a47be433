"""The templates: cut, topology and clearance on the shipped body."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from rasterize.charts import boundary_loops
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.cut import cut, place
from uvcloth.garments.order import check_order
from uvcloth.garments.shells import joint
from uvcloth.garments.templates import TEMPLATES, faces_outward, fit_template, load_template, save_template
from uvcloth.geometry.mesh import join_meshes
from uvcloth.physics.self_intersection import crossing_edges_percent
from uvcloth.physics.surface import BodySurface

OPENINGS = {"tops": 4, "bottoms": 3, "dress": 4, "shirt": 4, "skirt": 2, "jacket": 3}


def test_a_cut_through_a_sphere_is_exact() -> None:
    ball = trimesh.creation.icosphere(4)
    height = ball.vertices[:, 2] - 0.3
    edges, along, faces = cut(ball.faces, height)
    cap = trimesh.Trimesh(place(ball.vertices, edges, along), faces, process=False)
    assert cap.vertices[:, 2].min() == pytest.approx(0.3, abs=1e-9)
    assert cap.area == pytest.approx(2 * np.pi * 0.7, rel=5e-3)
    assert cap.is_winding_consistent
    (rim,) = boundary_loops(faces)
    np.testing.assert_allclose(cap.vertices[rim][:, 2], 0.3, atol=1e-9)
    assert np.linalg.norm(cap.vertices[rim][:, :2], axis=1) == pytest.approx(np.sqrt(1 - 0.09), rel=5e-3)


@pytest.mark.parametrize("name", TEMPLATES)
def test_templates_are_clean_garments(name: str, body: Body) -> None:
    garment = fit_template(name, body)
    mesh = trimesh.Trimesh(garment.mesh.vertices.numpy(), garment.mesh.faces.numpy(), process=False)
    assert 3000 <= len(mesh.vertices) <= 4500
    assert mesh.body_count == 1
    assert mesh.is_winding_consistent
    assert np.bincount(mesh.edges_unique_inverse).max() == 2
    assert len(boundary_loops(garment.mesh.faces.numpy())) == OPENINGS[name]
    assert mesh.edges_unique_length.max() < 0.04
    skin = BodySurface(body.mesh.vertices, body.mesh.faces).closest(garment.mesh.vertices)
    assert float(skin.signed_distance.min()) > 0.003
    assert faces_outward(garment.mesh, body)
    assert len(garment.mesh.face_uvs) == len(garment.mesh.faces)
    assert 0 <= float(garment.mesh.uvs.min()) <= float(garment.mesh.uvs.max()) <= 1


@pytest.mark.parametrize("name", TEMPLATES)
def test_the_band_holds_what_it_should(name: str, body: Body) -> None:
    template, garment = load_template(name), fit_template(name, body)
    band = garment.mesh.vertices[template.band]
    joints = dict(zip(body.skeleton.names, body.skeleton.heads, strict=True))
    top = float(band[:, 2].max())
    expected = joints["LowerBack"] if name in ("bottoms", "skirt") else joints["Neck"]
    assert abs(top - float(expected[2])) < 0.08
    torch.testing.assert_close(garment.smooth_weights.sum(1), torch.ones(len(garment.smooth_weights)))


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_the_shirt_reaches_the_wrists_and_leaves_them_room(side: str, body: Body) -> None:
    garment = fit_template("shirt", body)
    joints = dict(zip(body.skeleton.names, body.skeleton.heads.numpy(), strict=True))
    elbow, wrist = joints[f"{side}ForeArm"], joints[f"{side}Hand"]
    axis = (wrist - elbow) / np.linalg.norm(wrist - elbow)
    cloth = garment.mesh.vertices.numpy()
    hems = [cloth[run] for run in boundary_loops(garment.mesh.faces.numpy())]
    cuff = min(hems, key=lambda hem: float(np.linalg.norm(hem.mean(0) - wrist)))
    along = (cuff - wrist) @ axis
    assert -0.005 < along.min() < along.max() < 0.025
    skin = trimesh.Trimesh(body.mesh.vertices.numpy(), body.mesh.faces.numpy(), process=False)
    around = skin.section(plane_origin=wrist, plane_normal=axis).discrete
    thin = min(np.linalg.norm(np.diff(ring, axis=0), axis=1).sum() for ring in around)
    assert 1.3 < np.linalg.norm(np.roll(cuff, 1, 0) - cuff, axis=1).sum() / thin < 1.6


def test_the_jacket_is_open_in_front_and_lies_over_shirt_and_trousers(body: Body) -> None:
    garments = [fit_template(name, body) for name in ("bottoms", "shirt", "jacket")]
    check_order(garments)
    outfit = join_meshes((garment.mesh.vertices, garment.mesh.faces) for garment in garments)
    assert float(crossing_edges_percent(outfit.vertices[None], outfit.faces)[0]) == 0.0
    cloth, neck = garments[2].mesh.vertices, joint(body, "Neck")
    front = cloth[(cloth[:, 1] < float(neck[1]) - 0.06) & (cloth[:, 2] < float(neck[2]) - 0.06)]
    assert 0.02 < float(front[:, 0].abs().min()) < 0.05
    chest, hem = float(joint(body, "Spine1")[2]), float(cloth[:, 2].min())
    assert float(front[:, 2].max()) > chest
    assert float(front[:, 2].min()) < hem + 0.03


def test_the_skirt_is_wide_and_ends_at_the_knees(body: Body) -> None:
    mesh = fit_template("skirt", body).mesh
    waist, hem = sorted(
        (mesh.vertices[run] for run in boundary_loops(mesh.faces.numpy())),
        key=lambda run: -float(run[:, 2].mean()),
    )
    assert float(hem[:, 2].mean()) == pytest.approx(joint(body, "LeftLeg")[2], abs=0.05)
    around = [float((run - run.roll(1, 0)).norm(dim=1).sum()) for run in (waist, hem)]
    assert around[1] > 3 * around[0]


def test_indices_of_any_size_survive_the_file(tmp_path: Path) -> None:
    template = load_template("dress")
    fine = replace(template, faces=template.faces + 2**16)
    save_template(fine, tmp_path / "fine.npz")
    with np.load(tmp_path / "fine.npz") as saved:
        assert (saved["faces"] == fine.faces.numpy()).all()
        assert (saved["anchor_faces"] == template.anchor_faces.numpy()).all()


def test_an_unknown_template_is_refused() -> None:
    with pytest.raises(InputError, match="cape"):
        load_template("cape")
