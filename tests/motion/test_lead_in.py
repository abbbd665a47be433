"""The start from rest: continuous in place and speed, and ending exactly where the clip begins."""

from dataclasses import replace

import torch
import trimesh

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import TORSO_PART, make_collider
from uvcloth.geometry.skinning import skin
from uvcloth.motion.arms import TORSO_CLEARANCE, missing_clearance
from uvcloth.motion.lead_in import LeadIn, _rotations, lead_in
from uvcloth.motion.library import load_clip

PARTS = LeadIn(rest=4, blend=24, ramp=12)


def test_the_clip_itself_is_unchanged(body: Body) -> None:
    clip = load_clip("walk", body)
    led = lead_in(clip, body, PARTS)
    assert len(led) == len(clip) + len(PARTS)
    torch.testing.assert_close(led.rotations[len(PARTS) :], clip.rotations)
    torch.testing.assert_close(led.translation[len(PARTS) :], clip.translation)


def test_it_starts_at_rest_on_the_floor(body: Body) -> None:
    led = lead_in(load_clip("run", body), body, PARTS)
    posed = skin(body.mesh.vertices, body.weights, led.transforms()[: PARTS.rest])
    assert abs(float(posed[..., 2].amin())) < 1e-4
    torch.testing.assert_close(posed[0], posed[-1])
    some, rest = posed[0, ::500], body.mesh.vertices[::500]
    pairs = (some[:, None] - some).norm(dim=-1)
    torch.testing.assert_close(pairs, (rest[:, None] - rest).norm(dim=-1), atol=1e-4, rtol=0)


def test_it_reaches_the_clip_at_the_clips_own_speed(body: Body) -> None:
    clip = load_clip("run", body)
    led = lead_in(clip, body, PARTS)
    hips = led.translation
    step = (hips[1:] - hips[:-1]).norm(dim=1)
    first = len(PARTS)
    assert abs(float(step[first - 1] - step[first])) < 0.15 * float(step[first])
    jump = (step[1:] - step[:-1]).abs()
    assert float(jump[: first - 1].max()) < 2.5 * float(jump[first:].max()) + 0.01


def hands_inside(body: Body, transforms: torch.Tensor) -> list[bool]:
    """For each frame, whether a wrist or the knuckles are in the torso, as trimesh's rays say."""
    collider = make_collider(body)
    joints = [
        body.skeleton.names.index(f"{side}{part}")
        for side in ("Left", "Right")
        for part in ("Hand", "HandFinger1")
    ]
    heads = body.skeleton.heads[joints, :, None]
    places = (transforms[:, joints, :, :3] @ heads)[..., 0] + transforms[:, joints, :, 3]
    skin_at = collider.vertices(skin(body.mesh.vertices, body.weights, transforms))
    torsos = (trimesh.Trimesh(points.numpy(), collider.parts[TORSO_PART].numpy()) for points in skin_at)
    return [bool(torso.contains(at.numpy()).any()) for torso, at in zip(torsos, places, strict=True)]


def test_a_swinging_arm_does_not_begin_in_the_torso(body: Body) -> None:
    clip = load_clip("spin", body).window(54, 20)
    led = lead_in(clip, body, PARTS)
    straight = torch.cat([_rotations(clip, PARTS), clip.rotations])
    inside = replace(led, rotations=straight).transforms()[:41]
    missing = missing_clearance(body, inside)
    assert float(missing.max()) > 0.05 + TORSO_CLEARANCE
    assert any(hands_inside(body, inside[14:17]))
    mended = led.transforms()[:41]
    assert float(missing_clearance(body, mended).max()) < 0.01
    assert not any(hands_inside(body, mended[::4]))
    turns = (led.rotations[1:] - led.rotations[:-1]).abs().flatten(1).amax(1)
    assert float(turns[: len(PARTS)].max()) < 1.5 * float(turns[len(PARTS) :].max())


def test_arms_that_stay_outside_go_straight(body: Body) -> None:
    clip = load_clip("run", body).window(0, 2)
    led = lead_in(clip, body, PARTS)
    assert torch.equal(led.rotations[: len(PARTS)], _rotations(clip, PARTS))
    arms = missing_clearance(body, led.transforms())
    assert arms.shape == (42, 2)
    assert float(arms[0].max()) < -0.15
