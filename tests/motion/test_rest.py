"""Rest poses, and motions that no person can have made: what is asked for decides, what cannot be is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from rasterize.errors import InputError
from tests.motion.families import FAMILIES
from tests.motion.layouts import difference, write_layout
from uvcloth.bodies.body import Body
from uvcloth.geometry.skinning import skin
from uvcloth.motion.clip import Clip
from uvcloth.motion.lead_in import pose_from_rest
from uvcloth.motion.library import load_clip, load_source
from uvcloth.motion.options import MotionOptions
from uvcloth.motion.posture import check_posture


@pytest.fixture(scope="module")
def walk(body: Body) -> Clip:
    return load_clip("walk", body).window(20, 45)


def with_stand(walk: Clip, heading: float) -> Clip:
    """The walk after one frame of standing at rest, turned to a heading about the vertical."""
    turn = torch.from_numpy(Rotation.from_euler("z", heading).as_matrix()).float()
    stand = turn.expand(1, *walk.rotations.shape[1:])
    return replace(
        walk,
        rotations=torch.cat([stand, walk.rotations]),
        translation=torch.cat([walk.translation[:1], walk.translation]),
    )


def test_a_named_frame_is_the_rest_pose_whatever_its_heading(walk: Clip, tmp_path: Path, body: Body) -> None:
    layout = FAMILIES["Rokoko, any zero pose"]
    path = tmp_path / "walk.bvh"
    write_layout(with_stand(walk, 0.6), layout, path)
    found = load_clip(path, body, MotionOptions(rest_frame=0, frames="1:"))
    gap = difference(found, walk, layout.names())
    assert gap.degrees < 6.0, gap
    assert gap.centimetres < 1.0, gap


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (MotionOptions(rest_frame=45), "--rest-frame 45: the file has the frames 0 to 44"),
        (MotionOptions(frames="50:60"), "--frames 50:60: expected A:B within the motion's 45 frames"),
        (MotionOptions(frames="7"), "--frames 7: expected A:B"),
        (MotionOptions(up="z", rest_frame=None), "knees bend backwards|on one side"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    walk: Clip, tmp_path: Path, body: Body, options: MotionOptions, sentence: str
) -> None:
    path = tmp_path / "walk.bvh"
    # Swapped sides turn up whatever axis is asked for.
    layout = FAMILIES["MotionBuilder"]
    if options.up:
        layout = replace(layout, sides=layout.sides.replace("{S}", "{O}"))
        write_layout(walk, replace(layout, sides=swapped(layout.sides)), path)
        path.write_text(exchange(path.read_text()))
    else:
        write_layout(walk, layout, path)
    with pytest.raises(InputError, match=rf"walk\.bvh: .*({sentence})"):
        load_clip(path, body, options)
