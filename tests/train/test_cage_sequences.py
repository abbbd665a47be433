"""Training motion simulated on cages is read as sequences of `uvcloth simulate` are."""

from pathlib import Path

import pytest

from train.cage_sequences import CageSequences
from uvcloth.bodies.body import Body
from uvcloth.dataset.reader import read_clips, require_rests
from uvcloth.errors import InputError
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.skinning import skin
from uvcloth.methods.registry import SHIPPED
from uvcloth.motion.index import INDEX

WINDOWS = """trial,subject,split,action,window_start,window_frames,file
jog,one,train,run,0,30,run.npz
held,two,validation,run,0,30,run.npz
"""
FRAMES = 17


def test_sequences_are_those_of_training_clips(tmp_path: Path, body: Body) -> None:
    (tmp_path / INDEX).write_text(WINDOWS, encoding="utf-8")
    data = tmp_path / "data"
    command = CageSequences(
        data, tmp_path / INDEX, SHIPPED.parent / "clips", ("skirt",), "fast", motions=2, most_frames=FRAMES
    )
    command.run()
    ((_, clips),) = read_clips([data], ("skirt",))
    assert [(clip.name, clip.split, clip.subject) for clip in clips] == [
        ("jog", "train", "one"),
        ("jog_varied1", "train", "one"),
    ]
    garment = fit_template("skirt", body)
    require_rests({"skirt": garment.mesh.vertices}, clips, body)
    for clip in clips:
        vertices = clip.vertices.float()
        assert len(vertices) == FRAMES > clip.warm_up > 0
        skinned = skin(garment.mesh.vertices, garment.smooth_weights, clip.transforms)
        assert 0.005 < float((vertices - skinned).norm(dim=2).mean()) < 0.2
    assert not clips[0].has_motion_of(clips[1])
    times = [path.stat().st_mtime_ns for path in sorted(data.glob("*.npz"))]
    command.run()
    assert [path.stat().st_mtime_ns for path in sorted(data.glob("*.npz"))] == times


def test_an_unknown_quality_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--quality coarse: expected one of"):
        CageSequences(tmp_path, tmp_path / INDEX, quality="coarse").run()
