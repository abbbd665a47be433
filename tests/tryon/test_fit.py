"""The body in the pose of a person of whom only keypoints are known; here our body, so the pose is known."""

from functools import cache

import pytest
import torch

from tests.tryon.people import SIZE, VIEW, pictured
from uvcloth.bodies.body import Body, load_body
from uvcloth.errors import InputError
from uvcloth.motion.library import load_clip
from uvcloth.rendering.render import project
from uvcloth.tryon import fit
from uvcloth.tryon.fit import FittedPerson, fit_person, require_fit
from uvcloth.tryon.keypoints import BODY_25, Keypoints
from uvcloth.tryon.landmarks import landmarks, posed_landmarks

LIMBS = [name for name in BODY_25 if name.split("_")[-1] in ("shoulder", "elbow", "wrist", "knee", "ankle")]


@cache
def body() -> Body:
    return load_body()


def test_a_known_pose_is_found() -> None:
    """With 2 pixels of noise and four keypoints missing, from behind."""
    truth, pixels = pictured(load_clip("walk", body()), 31, 2.6, body())
    noisy = pixels + 2.0 * torch.randn(25, 2, generator=torch.Generator().manual_seed(0))
    kept = [index for index, name in enumerate(BODY_25) if index % 7]
    names = tuple(BODY_25[index] for index in kept)
    person = fit_person(Keypoints(names, noisy[kept], torch.ones(len(kept))), body(), SIZE, VIEW)
    require_fit(person, "keypoints.json")
    assert person.error < 4.0
    assert person.relative < 0.03
    fitted = person.clip.transforms()
    ours, theirs = (posed_landmarks(*landmarks(body(), LIMBS), each)[0] for each in (truth, fitted))
    root = truth[0, 0, :, :3] @ body().skeleton.heads[0] + truth[0, 0, :, 3]
    missed = ((ours - root) - (theirs - person.clip.translation[0])).norm(dim=1)
    assert missed.mean() < 0.08
    check_camera(person, names)


def check_camera(person: FittedPerson, names: tuple[str, ...]) -> None:
    """The camera of the pictures sees the landmarks where the fit says, and the body stands on the floor."""
    points = posed_landmarks(*landmarks(body(), names), person.clip.transforms())[0]
    drawn = torch.from_numpy(project(points.numpy(), person.camera, SIZE)[:2].T).float()
    torch.testing.assert_close(drawn, person.joints, atol=0.05, rtol=0)
    assert person.clip.translation[0, :2].abs().max() < 1e-5
    assert person.camera.eye[1] < -2.0


def test_keypoints_of_no_pose_are_refused(monkeypatch) -> None:
    """Every keypoint elsewhere in the picture."""
    monkeypatch.setattr(fit, "STEPS", 60)
    pixels = 100 + 500 * torch.rand(25, 2, generator=torch.Generator().manual_seed(1))
    person = fit_person(Keypoints(BODY_25, pixels, torch.ones(25)), body(), SIZE, VIEW)
    with pytest.raises(InputError, match=r"^a\.json: no pose of the body fits these keypoints"):
        require_fit(person, "a.json")


def test_landmarks_are_where_a_person_has_them() -> None:
    joints, points = landmarks(body(), BODY_25)
    at = dict(zip(BODY_25, points, strict=True))
    assert len(joints) == 25
    for part in ("eye", "ear", "shoulder", "wrist", "hip", "knee", "heel", "big_toe", "small_toe"):
        left, right = at[f"left_{part}"], at[f"right_{part}"]
        assert left[0] > 0.02
        torch.testing.assert_close(left * torch.tensor([-1.0, 1.0, 1.0]), right, atol=4e-3, rtol=0)
    assert at["nose"][1] < at["left_eye"][1] < at["left_ear"][1]
    assert at["nose"][2] < at["left_eye"][2]
    assert at["left_small_toe"][0] > at["left_big_toe"][0] + 0.03
    assert at["left_heel"][1] > at["left_ankle"][1] > at["left_big_toe"][1]
