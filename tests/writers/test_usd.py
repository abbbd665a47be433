from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import torch

from uvcloth.geometry.skinning import skin
from uvcloth.writers.animation import Animation
from uvcloth.writers.usd import write_usd
from uvcloth.writers.usd_stage import MAX_UNSAVED, SavedInParts

pxr = pytest.importorskip("pxr")
from pxr import Usd, UsdGeom, UsdSkel, UsdValidation  # noqa: E402


@pytest.fixture(scope="module")
def stage(animation: Animation, tmp_path_factory: pytest.TempPathFactory) -> Usd.Stage:
    path = tmp_path_factory.mktemp("usd") / "walk.usdc"
    write_usd(animation, path)
    return Usd.Stage.Open(str(path))


def test_samples_leave_memory_when_there_are_too_many() -> None:
    stage, saves = Mock(), []
    samples = SavedInParts(stage)
    for _ in range(6):
        samples.add(MAX_UNSAVED // 2)
        saves.append(stage.Save.call_count)
    assert saves == [0, 0, 1, 1, 1, 2]


def test_stage_says_its_units(stage: Usd.Stage, animation: Animation) -> None:
    assert UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert stage.GetTimeCodesPerSecond() == 30.0
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, len(animation) - 1)


def test_garment_points_and_texture_coordinates_are_exact(stage: Usd.Stage, animation: Animation) -> None:
    for name, mesh, vertices in zip(animation.names, animation.meshes, animation.vertices, strict=True):
        geometry = UsdGeom.Mesh(stage.GetPrimAtPath(f"/Outfit/{name}"))
        for frame in (0, 1, len(animation) - 1):
            np.testing.assert_array_equal(np.array(geometry.GetPointsAttr().Get(frame)), vertices[frame])
        faces = np.array(geometry.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
        np.testing.assert_array_equal(faces, mesh.faces.numpy())
        st = UsdGeom.PrimvarsAPI(geometry).GetPrimvar("st").ComputeFlattened()
        np.testing.assert_array_equal(np.array(st), mesh.uvs[mesh.face_uvs].reshape(-1, 2).numpy())


def test_garments_whose_names_share_an_identifier_are_numbered(animation: Animation, tmp_path: Path) -> None:
    twins = replace(animation, names=("my-shirt", "my_shirt"), body=None)
    write_usd(twins, tmp_path / "twins.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "twins.usdc"))
    for prim, vertices in zip(("my_shirt", "my_shirt_2"), twins.vertices, strict=True):
        points = UsdGeom.Mesh(stage.GetPrimAtPath(f"/Outfit/{prim}")).GetPointsAttr()
        np.testing.assert_array_equal(np.array(points.Get(0)), vertices[0])


def test_body_is_posed_by_its_skeleton(stage: Usd.Stage, animation: Animation, tmp_path: Path) -> None:
    """USD's own skinning, baked, against ours."""
    body = animation.body
    assert body is not None
    baked = Usd.Stage.Open(stage.Flatten())
    assert UsdSkel.BakeSkinning(UsdSkel.Root(baked.GetPrimAtPath("/Outfit/body")))
    points = UsdGeom.Mesh(baked.GetPrimAtPath("/Outfit/body/mesh")).GetPointsAttr()
    frames = [0, 11, len(animation) - 1]
    expected = skin(body.mesh.vertices, body.weights, torch.from_numpy(animation.transforms[frames])).numpy()
    for frame, vertices in zip(frames, expected, strict=True):
        assert np.abs(np.array(points.Get(frame)) - vertices).max() < 1e-5


def test_usd_validation_finds_no_error(stage: Usd.Stage) -> None:
    registry = UsdValidation.ValidationRegistry()
    validators = registry.GetOrLoadAllValidators()
    assert validators
    found = UsdValidation.ValidationContext(validators).Validate(stage)
    assert not found, [f"{error.GetName()}: {error.GetMessage()}" for error in found]
