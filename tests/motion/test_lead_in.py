"""The start from rest: continuous in place and speed, and ending exactly where the clip begins."""

import torch

from uvcloth.bodies.body import Body
from uvcloth.geometry.skinning import skin
from uvcloth.motion.lead_in import LeadIn, lead_in
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
