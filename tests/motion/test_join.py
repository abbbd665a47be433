"""One motion fades into another that goes on from where the first is and faces."""

import torch

from uvcloth.bodies.body import Body
from uvcloth.geometry.rotations import heading
from uvcloth.motion.capture import find_jump
from uvcloth.motion.join import join_clips
from uvcloth.motion.library import load_clip

FADE = 0.4


def test_a_walk_goes_on_in_a_run_without_a_jump(body: Body) -> None:
    walk, run = load_clip("walk", body).window(0, 40), load_clip("run", body).window(10, 30)
    joined = join_clips(walk, run, FADE)
    fade = round(FADE * walk.fps)
    assert len(joined) == len(walk) + len(run) - fade
    assert torch.equal(joined.rotations[: len(walk) - fade], walk.rotations[:-fade])
    assert find_jump(joined) is None
    # The run is the same but for one turn about the vertical and one way along the ground.
    after, own = joined.rotations[len(walk) :], run.rotations[fade:]
    turns = after @ own.mT
    torch.testing.assert_close(turns, turns[:1, :1].expand_as(turns), atol=1e-5, rtol=0)
    torch.testing.assert_close(turns[0, 0] @ heading(own[0, 0]), heading(after[0, 0]), atol=1e-5, rtol=0)
    steps = joined.translation[len(walk) :].diff(dim=0)
    torch.testing.assert_close(steps, run.translation[fade:].diff(dim=0) @ turns[0, 0].mT, atol=1e-5, rtol=0)


def test_a_clip_shorter_than_the_fade_is_joined_to(body: Body) -> None:
    walk, run = load_clip("walk", body).window(0, 40), load_clip("run", body).window(0, 4)
    assert len(join_clips(walk, run, FADE)) == len(walk) + len(run) - 3
