from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.layout import mirrored_vertices
from uvcloth.errors import InputError
from uvcloth.geometry.mirror import mirror_transforms
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.geometry.skinning import skin
from uvcloth.motion.clip_splits import SplitClip
from uvcloth.motion.draw_poses import draw_poses, local_angles
from uvcloth.motion.library import load_clip
from uvcloth.motion.poses import PoseDatabase

SOURCES = (
    SplitClip("jump", "jump", "train"),
    SplitClip("spin", "spin", "validation"),
    SplitClip("twirl", "twirl", "test"),
)


ACROSS = torch.tensor([-1.0, 1.0, 1.0])


def always(vertices: Tensor) -> bool:
    return True


@pytest.fixture(scope="module")
def drawn(body: Body) -> PoseDatabase:
    return draw_poses(SOURCES, body, always)


def distances(rotations: Tensor, others: Tensor, skeleton: Skeleton) -> np.ndarray:
    """The distance of section 4.3 by scipy, for every pair of poses."""

    def angles(world: Tensor) -> np.ndarray:
        local = [
            world[:, parent].mT @ world[:, joint] for joint, parent in enumerate(skeleton.parents) if joint
        ]
        turns = Rotation.from_matrix(torch.stack(local, 1).flatten(0, 1).double().numpy()).as_rotvec()
        return turns.reshape(len(world), 1, -1)

    return np.abs(angles(rotations) - angles(others).swapaxes(0, 1)).max(-1)


def test_any_two_poses_are_apart_over_all_splits(drawn: PoseDatabase, body: Body) -> None:
    between = distances(drawn.rotations, drawn.rotations, body.skeleton)
    assert between[~np.eye(len(drawn), dtype=bool)].min() >= 0.5 - 1e-5
    assert all(len(drawn.of(split)) > 3 for split in ("train", "validation", "test"))


def test_no_frame_is_left_that_could_be_drawn(drawn: PoseDatabase, body: Body) -> None:
    for source in SOURCES:
        frames = load_clip(source.file, body).rotations
        assert distances(frames, drawn.rotations, body.skeleton).min(1).max() < 0.5 + 1e-5


def test_each_pose_is_the_frame_that_it_says(drawn: PoseDatabase, body: Body) -> None:
    assert drawn.clip_names == ("jump", "spin", "twirl")
    for index, source in enumerate(SOURCES):
        rows = torch.nonzero((drawn.clips == index) & ~drawn.mirrored).squeeze(1)
        motion = load_clip(source.file, body).rotations
        torch.testing.assert_close(drawn.rotations[rows], motion[drawn.frames[rows]])
        assert (drawn.splits[drawn.clips == index] == index).all()
    flipped = drawn.select(torch.nonzero(drawn.mirrored).squeeze(1))
    assert len(flipped) > 0
    assert (flipped.clips == 0).all()
    motion = load_clip("jump", body).rotations[flipped.frames]
    torch.testing.assert_close(flipped.rotations, mirror_transforms(motion, body.skeleton))


def test_the_seed_decides(drawn: PoseDatabase, body: Body) -> None:
    again, other = draw_poses(SOURCES, body, always), draw_poses(SOURCES, body, always, seed=1)
    torch.testing.assert_close(again.rotations, drawn.rotations, atol=0, rtol=0)
    assert set(zip(other.clips.tolist(), other.frames.tolist(), strict=True)) != set(
        zip(drawn.clips.tolist(), drawn.frames.tolist(), strict=True)
    )


def test_only_poses_that_are_apart_are_asked_for_and_the_refused_left_out(body: Body) -> None:
    asked: list[bool] = []

    def low(vertices: Tensor) -> bool:
        asked.append(bool(vertices[:, 2].max() < 0.92))
        return asked[-1]

    poses = draw_poses(SOURCES[:1], body, low, mirror=False)
    assert sum(asked) == len(poses) < len(asked) < len(load_clip("jump", body))
    heights = skin(body.mesh.vertices, body.weights, poses.transforms(body.skeleton))[..., 2].amax(1)
    assert float(heights.max()) < 0.92 + 1e-5


def test_a_wider_distance_draws_fewer_poses(drawn: PoseDatabase, body: Body) -> None:
    plain = draw_poses(SOURCES, body, always, mirror=False)
    assert len(plain.of("train")) < len(drawn.of("train"))
    assert not plain.mirrored.any()
    assert len(draw_poses(SOURCES, body, always, apart=1.0)) < 0.7 * len(drawn)


def test_fewer_frames_are_looked_at_when_asked(body: Body) -> None:
    asked: list[Tensor] = []
    poses = draw_poses(SOURCES, body, lambda vertices: not asked.append(vertices), every=7)
    frames = sum(-(-len(load_clip(source.file, body)) // 7) for source in SOURCES)
    assert 0 < len(poses) <= len(asked) <= 2 * frames
    assert (poses.frames % 7 == 0).all()
    for index, source in enumerate(SOURCES):
        rows = torch.nonzero((poses.clips == index) & ~poses.mirrored).squeeze(1)
        motion = load_clip(source.file, body).rotations
        torch.testing.assert_close(poses.rotations[rows], motion[poses.frames[rows]])


def test_mirroring_twice_is_the_identity_and_keeps_distances(body: Body) -> None:
    motion = load_clip("dance", body).rotations[::10]
    once = mirror_transforms(motion, body.skeleton)
    torch.testing.assert_close(mirror_transforms(once, body.skeleton), motion, atol=0, rtol=0)
    assert float((once - motion).abs().max()) > 0.5
    plain, flipped = (local_angles(turns, body.skeleton) for turns in (motion, once))
    torch.testing.assert_close(
        torch.cdist(plain, plain, p=torch.inf), torch.cdist(flipped, flipped, p=torch.inf), atol=1e-4, rtol=0
    )


def symmetric(body: Body) -> tuple[Body, Tensor]:
    """The body without what its sides differ by (1 mm, and weights at the ankles), and the partners (V,)."""
    partners = mirrored_vertices(body)
    assert partners is not None
    joints = [body.skeleton.names.index(name) for name in partner_names(body.skeleton.names)]
    heads = 0.5 * (body.skeleton.heads + body.skeleton.heads[joints] * ACROSS)
    vertices = 0.5 * (body.mesh.vertices + body.mesh.vertices[partners] * ACROSS)
    even = replace(
        body,
        mesh=replace(body.mesh, vertices=vertices),
        skeleton=replace(body.skeleton, heads=heads),
        weights=0.5 * (body.weights + body.weights[partners][:, joints]),
    )
    return even, torch.from_numpy(partners)


def partner_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """The names of the default body's joints on the other side, written down another way than by the code."""
    right = [name.replace("Left", "Right") for name in names]
    thumbs = {"LThumb": "RThumb", "LHipJoint": "RHipJoint"}
    there = dict(zip(names, [thumbs.get(name, name) for name in right], strict=True))
    back = {there[name]: name for name in names if there[name] != name}
    return tuple(back.get(name, there[name]) for name in names)


def test_the_mirrored_pose_is_the_mirrored_body(body: Body) -> None:
    even, partners = symmetric(body)
    poses = draw_poses(SOURCES[:1], body, always, mirror=False)
    flipped = replace(poses, rotations=mirror_transforms(poses.rotations, body.skeleton))
    plain, mirrored = (
        skin(even.mesh.vertices, even.weights, some.transforms(even.skeleton)) for some in (poses, flipped)
    )
    torch.testing.assert_close(mirrored, plain[:, partners] * ACROSS, atol=1e-5, rtol=0)


@pytest.mark.parametrize(
    "names",
    [
        ("Hips", "LowerBack", "LThumb", "RThumb", "LeftArm", "RightArm"),
        (
            "mixamorig:Hips",
            "mixamorig:Spine",
            *(f"mixamorig:{s}{j}" for j in ("Leg", "Arm") for s in ("Left", "Right")),
        ),
        ("root", "Rib", "l_a", "L_Hip", "R_Hip", "Leftover"),
    ],
)
def test_sides_are_known_by_the_names_of_joints(names: tuple[str, ...]) -> None:
    rotations = torch.eye(3).repeat(1, 6, 1, 1) * torch.arange(1.0, 7.0)[:, None, None]
    skeleton = Skeleton(names, (-1, 0, 0, 0, 0, 0), torch.zeros(6, 3))
    order = mirror_transforms(rotations, skeleton)[0, :, 0, 0].tolist()
    swapped = [1.0, 2.0, 3.0, 5.0, 4.0, 6.0] if "root" in names else [1.0, 2.0, 4.0, 3.0, 6.0, 5.0]
    assert order == swapped


def test_what_is_wrong_is_named(body: Body) -> None:
    with pytest.raises(InputError, match="--apart 0"):
        draw_poses(SOURCES, body, always, apart=0.0)
    with pytest.raises(InputError, match="--every 0: expected a number of frames, 1 or more"):
        draw_poses(SOURCES, body, always, every=0)
    with pytest.raises(InputError, match="jump: no pose of the clips is valid on the body default"):
        draw_poses(SOURCES, body, lambda vertices: False)
    lonely = Skeleton(("Hips", "LeftArm"), (-1, 0), torch.zeros(2, 3))
    with pytest.raises(InputError, match="joint LeftArm: the skeleton has no RightArm"):
        mirror_transforms(torch.eye(3).repeat(1, 2, 1, 1), lonely)
