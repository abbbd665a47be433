"""Outfits in the runtime: the cloth of physics, wherever the scene is, and bad joints and times refused."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.thorough import always
from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Outfit as WornOutfit
from uvcloth.geometry.roles import joint_roles
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import PhysicsConfig, bake_outfit
from uvcloth.motion.library import load_clip
from uvcloth.player.outfit import Cloth, Outfit
from uvcloth.rollouts.rollout import rollout

FAST = PhysicsConfig("fast")
MILLIMETRE = 1e-3
FPS = 30.0

Joints = NDArray[np.float64]


@pytest.fixture(scope="module")
def twirl(body: Body) -> Joints:
    return np.asarray(load_clip("twirl", body).transforms(torch.float64).numpy()[:31])


def played(outfit: Outfit, joints: Joints) -> NDArray[np.float64]:
    """Vertices (F, N, 3) m of the only garment in each frame."""
    cloth = Cloth(outfit)
    cloth.start(joints[0])
    frames = []
    for transforms in joints:
        cloth.step(transforms, 1.0 / FPS)
        frames.append(cloth.vertices(0))
    return np.stack(frames)


def placed(joints: Joints, degrees: float, shift: tuple[float, float, float]) -> Joints:
    """The same motion in a scene that is turned about the vertical and shifted by metres."""
    moved = Rotation.from_euler("z", degrees, degrees=True).as_matrix() @ joints
    moved[..., 3] += shift
    return np.asarray(moved)


@pytest.fixture
def dressed(outfit: Outfit, twirl: Joints) -> Cloth:
    """Cloth after the first frame."""
    cloth = Cloth(outfit)
    cloth.start(twirl[0])
    cloth.step(twirl[0], 1.0 / FPS)
    return cloth


def test_the_first_frames_are_those_of_physics(worn: WornOutfit, outfit: Outfit, twirl: Joints) -> None:
    """Later ones part: cloth that touches itself makes millimetres of the last digit within some frames."""
    (garment,) = worn.garments
    assert outfit.joints == len(worn.body.skeleton.names)
    assert outfit.garments == (len(garment.mesh.vertices),)
    mine = played(outfit, twirl)
    assert np.isfinite(mine).all()
    frames = list(rollout(Physics(FAST), worn, torch.from_numpy(twirl[:3]), FPS))
    for frame, vertices in zip(frames, mine, strict=False):
        np.testing.assert_allclose(vertices, frame.vertices[0].numpy(), atol=0.1 * MILLIMETRE)


def test_cloth_is_shown_as_soon_as_it_rests(outfit: Outfit, dressed: Cloth, twirl: Joints) -> None:
    cloth = Cloth(outfit)
    cloth.start(twirl[0])
    assert np.abs(cloth.vertices(0) - dressed.vertices(0)).max() < 10 * MILLIMETRE


@pytest.mark.parametrize(
    ("degrees", "shift", "tolerance"),
    [(37.0, (0.0, 0.0, 0.0), 0.01), (0.0, (800.0, -600.0, 5.0), 0.1), (-143.0, (3.0, 1000.0, 0.0), 0.1)],
)
def test_a_turned_or_shifted_scene_has_the_same_cloth(
    outfit: Outfit, twirl: Joints, degrees: float, shift: tuple[float, float, float], tolerance: float
) -> None:
    here, there = played(outfit, twirl), played(outfit, placed(twirl, degrees, shift))
    back = Rotation.from_euler("z", -degrees, degrees=True).apply((there - shift).reshape(-1, 3))
    np.testing.assert_allclose(back.reshape(here.shape), here, rtol=0.0, atol=tolerance * MILLIMETRE)


def test_characters_in_two_threads_are_those_alone(outfit: Outfit, twirl: Joints) -> None:
    motions = [twirl[:12], twirl[12:24]]
    alone = [played(outfit, motion) for motion in motions]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(played, [outfit] * 2, motions))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, other)


def test_characters_in_turns_are_those_alone(outfit: Outfit, twirl: Joints) -> None:
    motions = [twirl[:6], placed(twirl[12:18], 30.0, (5.0, 0.0, 0.0))]
    alone = [played(outfit, motion) for motion in motions]
    pair = [Cloth(outfit), Cloth(outfit)]
    for cloth, motion in zip(pair, motions, strict=True):
        cloth.start(motion[0])
    for frame in range(6):
        for cloth, motion, expected in zip(pair, motions, alone, strict=True):
            cloth.step(motion[frame], 1.0 / FPS)
            np.testing.assert_array_equal(cloth.vertices(0), expected[frame])


@pytest.mark.parametrize("number", [np.nan, np.inf, 1e200, 2e7])
def test_joints_that_are_no_places_are_refused(dressed: Cloth, twirl: Joints, number: float) -> None:
    before, sentence = dressed.vertices(0), "the transform of joint 3 is not finite, or beyond 10,000 km"
    for column in (1, 3):
        wrong = twirl[1].copy()
        wrong[3, 0, column] = number
        with pytest.raises(ValueError, match=sentence):
            dressed.step(wrong, 1.0 / FPS)
        with pytest.raises(ValueError, match=sentence):
            Cloth(dressed.outfit).start(wrong)
    np.testing.assert_array_equal(dressed.vertices(0), before)


def test_other_numbers_of_joints_are_refused(dressed: Cloth, twirl: Joints) -> None:
    for wrong in (twirl[1, :-1], twirl[1, :, :, :3], twirl, np.zeros((0, 3, 4))):
        with pytest.raises(ValueError, match=r"transforms of 31 joints \(J, 3, 4\) were expected"):
            dressed.step(wrong, 1.0 / FPS)


@pytest.mark.parametrize("seconds", [0.0, -1.0, np.nan, 1e-60])
def test_a_frame_without_length_is_refused(dressed: Cloth, twirl: Joints, seconds: float) -> None:
    before = dressed.vertices(0)
    with pytest.raises(ValueError, match="a frame takes no time"):
        dressed.step(twirl[0], seconds)
    np.testing.assert_array_equal(dressed.vertices(0), before)


def test_frames_may_be_short_and_long(dressed: Cloth, twirl: Joints) -> None:
    for seconds in (1e-9, 1e-20, 1.0, 1.0 / FPS):
        dressed.step(twirl[0], seconds)
        assert np.isfinite(dressed.vertices(0)).all()
    with pytest.raises(ValueError, match="needs too many substeps"):
        dressed.step(twirl[0], np.inf)
    away = twirl[0].copy()
    away[5:, 0, 3] += 0.001
    with pytest.raises(ValueError, match="the body moves at"):
        dressed.step(away, 1e-9)


JUMPS = ((0.0, (0.5, 0.0, 0.0)), (90.0, (100.0, 0.0, 5.0)), (-90.0, (0.0, 0.0, 0.0)))
"""Degrees of a turn and metres of a shift."""


@pytest.mark.parametrize(
    ("frame", "jump"),
    always([(0, JUMPS[0]), (1, JUMPS[2]), (12, JUMPS[1])], product([0, 1, 12], JUMPS)),
)
def test_cloth_comes_along_where_the_body_jumps(
    outfit: Outfit, twirl: Joints, frame: int, jump: tuple[float, tuple[float, float, float]]
) -> None:
    """The body is elsewhere from a frame on; the cloth on it is as if it had been there before."""
    degrees, shift = jump
    jumping = np.concatenate([twirl[:frame], placed(twirl[frame:], degrees, shift)])
    expected, frames = played(outfit, twirl), played(outfit, jumping)
    np.testing.assert_array_equal(frames[:frame], expected[:frame])
    back = Rotation.from_euler("z", -degrees, degrees=True).apply((frames[frame:] - shift).reshape(-1, 3))
    apart = np.linalg.norm(back.reshape(frames[frame:].shape) - expected[frame:], axis=2)
    assert apart[:3].max() < 50 * MILLIMETRE
    assert apart[-1].mean() < 100 * MILLIMETRE


def test_a_body_that_jumps_back_has_its_cloth(outfit: Outfit, twirl: Joints) -> None:
    there = placed(twirl[:1], 0.0, (100.0, 0.0, 0.0))[0]
    still = played(outfit, np.stack([twirl[0]] * 8))
    back = played(outfit, np.stack([twirl[0], twirl[0], there, twirl[0], there, *[twirl[0]] * 3]))
    np.testing.assert_allclose(back[-1], still[-1], atol=1e-3 * MILLIMETRE)


def test_a_limb_that_jumps_is_refused(outfit: Outfit, twirl: Joints) -> None:
    cloth, expected = Cloth(outfit), played(outfit, twirl[:4])
    cloth.start(twirl[0])
    for transforms in twirl[:3]:
        cloth.step(transforms, 1.0 / FPS)
    for shift in (100.0, 1e6):
        away = placed(twirl[3:4], 90.0, (shift, 0.0, 0.0))[0]
        away[5:, 0, 3] += 100.0
        with pytest.raises(ValueError, match=r"the body moves at \d+ m/s .*the limit is 40 m/s"):
            cloth.step(away, 1.0 / FPS)
        np.testing.assert_array_equal(cloth.vertices(0), expected[2])
    cloth.step(twirl[3], 1.0 / FPS)
    np.testing.assert_array_equal(cloth.vertices(0), expected[3])


def test_a_leg_goes_through_the_other_one(body: Body, outfit: Outfit, twirl: Joints) -> None:
    """And comes back: the skirt around both stays whole."""
    names, parents = body.skeleton.names, body.skeleton.parents
    thigh = joint_roles(names)["left_thigh"]
    leg = [thigh]
    for joint in range(thigh + 1, len(names)):
        if parents[joint] in leg:
            leg.append(joint)
    motion = np.repeat(twirl[:1], 24, axis=0)
    head = motion[0, thigh] @ [*body.skeleton.heads[thigh].tolist(), 1.0]
    for frame, share in enumerate(np.sin(np.linspace(0.0, np.pi, len(motion)))):
        turn = Rotation.from_rotvec([0.0, 0.9 * share, 0.0]).as_matrix()
        motion[frame, leg, :, 3] -= head
        motion[frame, leg] = turn @ motion[frame, leg]
        motion[frame, leg, :, 3] += head
    frames = played(outfit, motion)
    assert np.isfinite(frames).all()
    assert np.linalg.norm(frames - frames[0], axis=2).max() < 0.8
    assert np.linalg.norm(frames[-1] - frames[0], axis=1).mean() < 0.1


def test_a_state_that_is_refused_changes_nothing(outfit: Outfit, twirl: Joints) -> None:
    cloth, expected = Cloth(outfit), played(outfit, twirl[:4])
    cloth.start(twirl[0])
    for transforms in twirl[:3]:
        cloth.step(transforms, 1.0 / FPS)
    state = cloth.save()
    # Its last bytes are pairs of edges, which begin with indices; a quarter is those of faces.
    for wrong in (state[:-4], np.append(state, state[:4]), np.append(state[:-24], state[:24]), state[:0]):
        with pytest.raises(ValueError, match="the bytes are not those of cloth in this outfit"):
            cloth.restore(wrong)
    cloth.step(twirl[3], 1.0 / FPS)
    np.testing.assert_array_equal(cloth.vertices(0), expected[3])
    cloth.restore(state)
    cloth.step(twirl[3], 1.0 / FPS)
    np.testing.assert_array_equal(cloth.vertices(0), expected[3])


def test_cloth_has_to_be_started_first(outfit: Outfit, twirl: Joints) -> None:
    cloth = Cloth(outfit)
    with pytest.raises(ValueError, match="the cloth has not come to rest yet: start it first"):
        cloth.step(twirl[0], 1.0 / FPS)
    assert np.isfinite(cloth.vertices(0)).all()


def test_garments_are_counted_from_both_ends(dressed: Cloth) -> None:
    np.testing.assert_array_equal(dressed.vertices(-1), dressed.vertices(0))
    for wrong in (1, -2):
        with pytest.raises(IndexError):
            dressed.vertices(wrong)


def test_a_garment_of_one_triangle_is_played(worn: WornOutfit, twirl: Joints) -> None:
    (garment,) = worn.garments
    faces = garment.mesh.faces[:1]
    kept, corners = faces.unique(), torch.arange(3)[None]
    order = torch.searchsorted(kept, faces)
    mesh = replace(
        garment.mesh,
        vertices=garment.mesh.vertices[kept],
        faces=order,
        uvs=torch.eye(3)[:, :2],
        face_uvs=corners,
    )
    small = replace(
        garment,
        template=None,
        mesh=mesh,
        weights=garment.weights[kept],
        smooth_weights=garment.smooth_weights[kept],
    )
    made = Outfit(bake_outfit(replace(worn, garments=(small,)), FAST))
    assert made.garments == (3,)
    assert np.isfinite(played(made, twirl[:4])).all()
