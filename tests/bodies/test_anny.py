"""Our skinning against Anny's own forward pass, and templates on bodies of other shapes."""

from importlib.util import find_spec
from pathlib import Path

import pytest
import torch

from tests.bodies.test_body import random_rotations
from tests.thorough import always
from uvcloth.bodies.anny import DEFAULT_PHENOTYPE, make_body, rig
from uvcloth.errors import InputError
from uvcloth.garments.templates import LEAST_CLEARANCE, TEMPLATES, load_template, tailored
from uvcloth.geometry.skeleton import joint_transforms
from uvcloth.geometry.skinning import skin
from uvcloth.physics.surface import BodySurface

# Not imported before it is needed: every process that runs tests would take two seconds.
pytestmark = pytest.mark.skipif(find_spec("anny") is None, reason="the `body` extra is not installed")

SHAPES = {
    "default": {},
    "slim": {"weight": 0.1, "muscle": 0.2},
    "heavy": {"weight": 0.95, "gender": 0.4},
    "small": {"height": 0.05, "age": 0.5},
    "tall": {"height": 0.95, "gender": 0.1},
}


@pytest.mark.parametrize("shape", always(["default", "small"], SHAPES))
def test_skinning_equals_anny(shape: str) -> None:
    model = rig("anny")
    body = make_body(shape, SHAPES[shape])
    poses, joints = 20, len(body.skeleton.names)
    half = torch.lerp(torch.eye(3), random_rotations(poses, joints, seed=len(shape)), 0.3)
    u, _, v = torch.linalg.svd(half)
    local = torch.eye(4, dtype=torch.float64).repeat(poses, joints, 1, 1)
    local[..., :3, :3] = (u @ v).double()
    local[:, 0, :3, 3] = torch.tensor([0.3, -0.2, 1.0])
    phenotype = {**DEFAULT_PHENOTYPE, **SHAPES[shape]}
    output = model(pose_parameters=local, phenotype_kwargs=phenotype)
    moved = output["bone_poses"] @ torch.linalg.inv(output["rest_bone_poses"])
    kept = _indices(model, body.mesh.vertices, output["rest_vertices"][0].float())

    rotations = moved[..., :3, :3].float()
    root = (moved[:, 0, :3, :3] @ body.skeleton.heads[0].double() + moved[:, 0, :3, 3]).float()
    transforms = joint_transforms(body.skeleton, rotations, root)
    ours = skin(body.mesh.vertices, body.weights, transforms)
    assert float((ours - output["vertices"][:, kept].float()).abs().max()) < 1e-5


def _indices(model: object, vertices: torch.Tensor, everything: torch.Tensor) -> torch.Tensor:
    """Which of Anny's vertices are the body's, by position at rest."""
    from scipy.spatial import KDTree

    distance, index = KDTree(everything.numpy()).query(vertices.numpy())
    assert distance.max() < 1e-6
    return torch.from_numpy(index)


@pytest.mark.parametrize("shape", always(["heavy"], ["slim", "heavy", "small", "tall"]))
def test_templates_keep_off_the_skin_of_other_shapes(shape: str) -> None:
    body = make_body(shape, SHAPES[shape])
    surface = BodySurface(body.mesh.vertices, body.mesh.faces)
    for name in TEMPLATES:
        mesh = tailored(load_template(name), body)
        assert float(surface.closest(mesh.vertices).signed_distance.min()) > LEAST_CLEARANCE - 5e-4


def test_a_phenotype_out_of_range_is_refused() -> None:
    with pytest.raises(InputError, match="weight"):
        make_body("b", {"weight": 1.5})
    with pytest.raises(InputError, match="armspan"):
        make_body("b", {"armspan": 0.5})


def test_where_no_home_can_be_written_anny_caches_among_temporary_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from anny.paths import get_anny_cache_path, set_anny_cache_path

    monkeypatch.setattr("rasterize.cache_folder.gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr("anny.Anny", lambda **_: get_anny_cache_path())
    usual = get_anny_cache_path()
    try:
        assert rig("anny") == usual
        (tmp_path / "home").touch()
        set_anny_cache_path(tmp_path / "home" / ".cache" / "anny")
        assert rig("anny").is_relative_to(tmp_path)
        assert rig("anny").is_dir()
    finally:
        set_anny_cache_path(usual)
