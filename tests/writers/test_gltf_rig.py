"""The rig's file read back and evaluated by the specification's rules, and the Khronos validator."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.writers.glb_reader import GlbReader, require_clean, to_z_up
from tests.writers.played import rolled_out
from uvcloth.garments.garment import Outfit
from uvcloth.geometry.mesh import vertex_normals
from uvcloth.geometry.skinning import skin
from uvcloth.methods.pbns.method import PBNS
from uvcloth.methods.rig import PoseRig
from uvcloth.motion.clip import Clip
from uvcloth.writers.gltf_rig import write_rig_glb
from uvcloth.writers.rig import rig_of

MILLIMETRE = 1e-3


@pytest.fixture(scope="module")
def path(pose_rig: PoseRig, outfit: Outfit, clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rig") / "wave.glb"
    write_rig_glb(rig_of(pose_rig, outfit.body, clip).rig, path)
    return path


def test_the_file_plays_the_rollout(path: Path, rolled: list[np.ndarray], outfit: Outfit, clip: Clip) -> None:
    glb = GlbReader.load(path)
    np.testing.assert_allclose(glb.times(), np.arange(len(clip)) / 30.0, atol=1e-6)
    for frame in range(0, len(clip), 4):
        for garment, vertices in zip(outfit.garments, rolled, strict=True):
            written = glb.posed(garment.name, frame)
            apart = np.linalg.norm(written - vertices[frame, glb.source(garment.name)], axis=1)
            assert apart.max() < 0.05 * MILLIMETRE


def test_weights_stay_where_engines_do_not_clamp_them(path: Path, outfit: Outfit, clip: Clip) -> None:
    glb = GlbReader.load(path)
    tracks = [glb.channels()[glb.node(garment.name), "weights"] for garment in outfit.garments]
    np.testing.assert_array_equal(*tracks)
    assert tracks[0].min() >= 0.0
    assert tracks[0].max() <= 1.0
    names = glb.mesh("shirt").extras["targetNames"]
    assert len(names) == len(set(names)) == tracks[0].size // len(clip)


def test_body_and_garments_share_the_skeleton(path: Path, outfit: Outfit, clip: Clip) -> None:
    glb = GlbReader.load(path)
    body = outfit.body
    assert len(glb.gltf.skins) == 1
    written = glb.posed("body", 7)
    expected = skin(body.mesh.vertices, body.weights, clip.transforms()[7:8])[0].numpy()
    error = np.linalg.norm(written - expected[glb.source("body")], axis=1)
    assert error.mean() < 0.2 * MILLIMETRE  # Of the body's seven influences four are left.


def test_four_influences_cost_what_the_rig_says(
    make_pbns: Callable[..., PBNS], outfit: Outfit, clip: Clip, tmp_path: Path
) -> None:
    many = make_pbns(influences=7)
    rigged = rig_of(many.as_rig(outfit.body), outfit.body, clip)
    write_rig_glb(rigged.rig, tmp_path / "many.glb")
    glb, expected = GlbReader.load(tmp_path / "many.glb"), rolled_out(many, outfit, clip)
    apart = np.concatenate(
        [
            np.linalg.norm(glb.posed(garment.name, frame)[: vertices.shape[1]] - vertices[frame], axis=1)
            for frame in range(0, len(clip), 4)
            for garment, vertices in zip(outfit.garments, expected, strict=True)
        ]
    )
    cost = rigged.pruning[1]
    print(f"four of seven influences: mean {1e3 * apart.mean():.3f} mm, max {1e3 * apart.max():.2f} mm")
    assert apart.mean() == pytest.approx(cost.mean, rel=0.3)
    assert apart.max() == pytest.approx(cost.most, rel=0.3)


@pytest.mark.parametrize("shapes", [None, 6])
def test_normals_follow_the_blend_shapes(
    pbns: PBNS, outfit: Outfit, clip: Clip, tmp_path: Path, shapes: int | None
) -> None:
    """At rest, against the normals of the morphed surface."""
    write_rig_glb(rig_of(pbns.as_rig(outfit.body), outfit.body, clip, shapes).rig, tmp_path / "wave.glb")
    glb = GlbReader.load(tmp_path / "wave.glb")
    for garment in outfit.garments:
        source, angles = glb.source(garment.name), []
        for frame in range(0, len(clip), 4):
            weights = glb.weights(garment.name, frame)
            surface = to_z_up(glb.morphed(garment.name, weights))[: len(garment.mesh.vertices)]
            true = vertex_normals(garment.mesh.vertices.new_tensor(surface), garment.mesh.faces).numpy()
            written = to_z_up(glb.morphed(garment.name, weights, "NORMAL"))
            lengths = np.linalg.norm(written, axis=1)
            angles.append(np.degrees(np.arccos(((written * true[source]).sum(1) / lengths).clip(-1, 1))))
        mean, most = np.mean(angles), np.percentile(angles, 95)
        print(f"{garment.name}: normals off by {mean:.2f} degrees, 95 %: {most:.2f}")
        assert mean < 1.0
        assert most < 3.0


def test_without_a_motion_the_file_stands_in_the_rest_pose(
    pose_rig: PoseRig, outfit: Outfit, tmp_path: Path
) -> None:
    rigged = rig_of(pose_rig, outfit.body, with_body=False)
    write_rig_glb(rigged.rig, tmp_path / "rig.glb")
    glb = GlbReader.load(tmp_path / "rig.glb")
    assert not glb.gltf.animations
    assert [mesh.name for mesh in glb.gltf.meshes] == ["shirt", "trousers"]
    np.testing.assert_allclose(glb.weights("shirt", None), rigged.rig.resting, atol=1e-7)
    standing = glb.posed("shirt", None)
    own = rigged.rig.garments[0].mesh.vertices.numpy()
    moved = own + np.einsum("k,knc->nc", rigged.rig.resting, rigged.rig.garments[0].shapes.numpy())
    np.testing.assert_allclose(standing[: len(own)], moved, atol=1e-5)


@pytest.mark.parametrize("moving", [True, False])
def test_khronos_validator_finds_nothing(
    pose_rig: PoseRig, outfit: Outfit, clip: Clip, tmp_path: Path, moving: bool
) -> None:
    rigged = rig_of(pose_rig, outfit.body, clip if moving else None, shapes=None if moving else 5)
    write_rig_glb(rigged.rig, tmp_path / "rig.glb")
    require_clean(tmp_path / "rig.glb")
