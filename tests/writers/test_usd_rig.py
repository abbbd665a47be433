"""The rig's stage, skinned and morphed by OpenUSD itself, against our rollout."""

from pathlib import Path

import numpy as np
import pytest

from uvcloth.garments.garment import Outfit
from uvcloth.geometry.skinning import skin
from uvcloth.methods.rig import PoseRig
from uvcloth.motion.clip import Clip
from uvcloth.writers.rig import rig_of
from uvcloth.writers.usd_rig import write_rig_usd

pxr = pytest.importorskip("pxr")
from pxr import Usd, UsdGeom, UsdSkel, UsdValidation  # noqa: E402


@pytest.fixture(scope="module")
def path(pose_rig: PoseRig, outfit: Outfit, clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rig") / "wave.usdc"
    write_rig_usd(rig_of(pose_rig, outfit.body, clip).rig, path)
    return path


def test_usd_s_own_skinning_meets_the_rollout(
    path: Path, rolled: list[np.ndarray], outfit: Outfit, clip: Clip
) -> None:
    baked = Usd.Stage.Open(Usd.Stage.Open(str(path)).Flatten())
    assert UsdSkel.BakeSkinning(UsdSkel.Root(baked.GetPrimAtPath("/Outfit")))
    frames = range(0, len(clip), 4)
    expected = dict(zip((g.name for g in outfit.garments), rolled, strict=True))
    body = outfit.body
    expected["body"] = skin(body.mesh.vertices, body.weights, clip.transforms()).numpy()
    for name, vertices in expected.items():
        points = UsdGeom.Mesh(baked.GetPrimAtPath(f"/Outfit/{name}")).GetPointsAttr()
        for frame in frames:
            assert np.linalg.norm(np.array(points.Get(frame)) - vertices[frame], axis=1).max() < 5e-5


@pytest.mark.parametrize("moving", [True, False])
def test_usd_validation_finds_no_error(
    pose_rig: PoseRig, outfit: Outfit, clip: Clip, tmp_path: Path, moving: bool
) -> None:
    write_rig_usd(rig_of(pose_rig, outfit.body, clip if moving else None).rig, tmp_path / "rig.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "rig.usdc"))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    found = UsdValidation.ValidationContext(validators).Validate(stage)
    assert not found, [f"{error.GetName()}: {error.GetMessage()}" for error in found]


def test_without_a_motion_the_stage_stands_in_the_rest_pose(
    pose_rig: PoseRig, outfit: Outfit, tmp_path: Path
) -> None:
    rig = rig_of(pose_rig, outfit.body, with_body=False).rig
    write_rig_usd(rig, tmp_path / "rig.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "rig.usdc"))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, 0)
    assert not stage.GetPrimAtPath("/Outfit/body")
    assert UsdSkel.BakeSkinning(UsdSkel.Root(stage.GetPrimAtPath("/Outfit")))
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/Outfit/trousers")).GetPointsAttr().Get(0)
    garment = rig.garments[1]
    moved = garment.mesh.vertices.numpy() + np.einsum("k,knc->nc", rig.resting, garment.shapes.numpy())
    np.testing.assert_allclose(np.array(points), moved, atol=1e-5)
