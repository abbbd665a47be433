"""Planning, keeping apart, and the sequence file."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.garments.templates import wear
from uvcloth.motion.library import load_clip
from uvcloth.simulate.accept import MOST_INSIDE, examine
from uvcloth.simulate.farm import plan
from uvcloth.simulate.sequence import Sequence, content_hash, load_sequence, save_sequence
from uvcloth.skinning import skin


@pytest.fixture(scope="module")
def carried(body: Body) -> Sequence:
    """A shirt that is simply skinned: outside the body for a small motion."""
    garment = wear("tops", body)
    transforms = load_clip("walk", body).transforms()[:4]
    return Sequence(
        vertices=skin(garment.mesh.vertices, garment.carrier_weights, transforms),
        faces=garment.mesh.faces,
        rest=garment.mesh.vertices,
        transforms=transforms,
        fps=30.0,
        settling=1,
        metadata={"clip": "walk", "garment": "tops", "body": body.name},
    )


def test_a_sequence_survives_its_file(carried: Sequence, tmp_path: Path) -> None:
    save_sequence(carried, tmp_path / "s.npz")
    again = load_sequence(tmp_path / "s.npz")
    assert torch.equal(again.vertices, carried.vertices)
    assert again.metadata["hash"] == content_hash(carried)
    assert (again.settling, again.garment, again.clip) == (1, "tops", "walk")
    assert [path.name for path in tmp_path.iterdir()] == ["s.npz"]


def test_exploded_and_swallowed_sequences_are_refused(carried: Sequence, body: Body) -> None:
    torn = carried.vertices.clone()
    torn[2, 100] += 5.0
    assert "frame 2" in str(examine(replace(carried, vertices=torn), body)[1])
    lost = carried.vertices.clone()
    lost[3, 0, 0] = float("nan")
    assert "finite" in str(examine(replace(carried, vertices=lost), body)[1])
    hips = carried.transforms[:, :1, :, :3] @ body.skeleton.heads[0] + carried.transforms[:, :1, :, 3]
    sunken = hips + 0.3 * (carried.vertices - hips)
    seen, reason = examine(replace(carried, vertices=sunken), body)
    assert "inside the body" in str(reason)
    assert seen.metadata["inside_percent"] > MOST_INSIDE


def test_a_sleeve_that_came_off_its_arm_is_refused(carried: Sequence, body: Body) -> None:
    assert examine(carried, body)[0].metadata["pierced_percent"] == 0.0
    names = body.skeleton.names
    shoulder, elbow = (body.skeleton.heads[names.index(name)] for name in ("LeftArm", "LeftForeArm"))
    along = torch.nn.functional.normalize(elbow - shoulder, dim=0)
    reach = (carried.rest - shoulder) @ along
    beside = (carried.rest - shoulder - reach[:, None] * along).norm(dim=1)
    sleeve = (carried.rest[:, 0] > 0.0) & (beside < 0.1)
    slid = carried.vertices.clone()
    slid[2:, :, 0] += 0.2 * sleeve * ((reach - 0.08) / 0.06).clamp(0.0, 1.0)
    assert "a limb has left its cloth in 67 %" in str(examine(replace(carried, vertices=slid), body)[1])


def test_windows_choose_frames_and_name_what_is_wrong(body: Body, tmp_path: Path) -> None:
    table = tmp_path / "index.csv"
    table.write_text(
        "trial,split,action,window_start,window_frames\nwalk,test,walking,40,30\nrun,test,run,90,50\n"
    )
    (job,) = plan(["walk"], ["dress"], tmp_path, body, table)
    assert (len(job.motion), job.settling, job.target.name) == (45, 15, "walk_dress.npz")
    (again,) = plan(["walk"], ["dress"], tmp_path, body, table, earlier=True)
    assert (len(again.motion), again.settling) == (65, 35)
    with pytest.raises(InputError, match="the window ends at 140"):
        plan(["run"], ["dress"], tmp_path, body, table)
    with pytest.raises(InputError, match="no row for the clip twirl"):
        plan(["twirl"], ["dress"], tmp_path, body, table)
    table.write_text("name\nwalk\n")
    with pytest.raises(InputError, match=r"index\.csv: lacks the column trial"):
        plan(["walk"], ["dress"], tmp_path, body, table)
