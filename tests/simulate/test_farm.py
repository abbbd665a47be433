"""Planning, keeping apart, and the sequence file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from rasterize.archive import load_arrays, save_arrays
from rasterize.errors import InputError
from uvcloth.bodies.body import Body
from uvcloth.garments.templates import wear
from uvcloth.motion.library import builtin_clips, load_clip
from uvcloth.simulate.accept import MOST_INSIDE, examine
from uvcloth.simulate.cloth import join
from uvcloth.simulate.farm import plan, simulate_batch
from uvcloth.simulate.sequence import (
    FORMAT,
    Sequence,
    content_hash,
    load_sequence,
    read_metadata,
    save_sequence,
)
from uvcloth.skinning import skin

HEADER = "trial,subject,split,action,window_start,window_frames\n"


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
    assert (again.vertices - carried.vertices).norm(dim=-1).max() < 5e-5
    for exact in ("rest", "faces", "transforms"):
        assert torch.equal(getattr(again, exact), getattr(carried, exact))
    assert again.metadata["hash"] == content_hash(again) == read_metadata(tmp_path / "s.npz")["hash"]
    assert again.metadata["counted"] == 3
    assert (again.settling, again.garment, again.clip) == (1, "tops", "walk")
    assert (again.template, again.layers) == ("tops", ("tops",))
    skirt = replace(carried, metadata={"clip": "walk", "garment": "skirt", "template": "dress"})
    assert (skirt.garment, skirt.template) == ("skirt", "dress")
    assert [path.name for path in tmp_path.iterdir()] == ["s.npz"]


def test_an_older_sequence_is_refused_with_the_way_to_a_new_one(tmp_path: Path) -> None:
    save_arrays(tmp_path / "s.npz", {"format": np.array("uvcloth-sequence-1")})
    for read in (load_sequence, read_metadata):
        with pytest.raises(InputError, match=r"simulate older ones again .* found format uvcloth-sequence-1"):
            read(tmp_path / "s.npz")


@pytest.mark.parametrize("part", ["vertices", "rest", "transforms"])
def test_a_sequence_with_a_number_that_is_not_finite_is_refused(
    carried: Sequence, tmp_path: Path, part: str
) -> None:
    save_sequence(replace(carried, **{part: getattr(carried, part) * float("nan")}), tmp_path / "s.npz")
    with pytest.raises(InputError, match=rf"s\.npz: {part} holds a value"):
        load_sequence(tmp_path / "s.npz")


@pytest.mark.parametrize(
    ("metadata", "words"),
    [("{", "not readable as JSON"), ("[]", "does not name"), ('{"clip": "walk"}', "does not name")],
)
def test_damaged_metadata_is_refused(carried: Sequence, tmp_path: Path, metadata: str, words: str) -> None:
    save_sequence(carried, tmp_path / "s.npz")
    arrays = load_arrays(tmp_path / "s.npz", FORMAT, "a sequence")
    save_arrays(tmp_path / "s.npz", {**arrays, "metadata": np.array(metadata)})
    with pytest.raises(InputError, match=rf"s\.npz: the metadata .*{words}"):
        load_sequence(tmp_path / "s.npz")


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
    table.write_text(HEADER + "walk,a,test,walking,40,30\nrun,b,test,run,90,50\n")
    dress = (join(wear("dress", body), body),)
    (job,) = plan(["walk"], [dress], tmp_path, body, table)
    assert (len(job.motion), job.settling, job.targets[0].name) == (45, 15, "walk_dress.npz")
    (again,) = plan(["walk"], [dress], tmp_path, body, table, earlier=True)
    assert (len(again.motion), again.settling) == (65, 35)
    with pytest.raises(InputError, match="the window ends at 140"):
        plan(["run"], [dress], tmp_path, body, table)
    with pytest.raises(InputError, match="no row for the clip twirl"):
        plan(["twirl"], [dress], tmp_path, body, table)
    table.write_text("name\nwalk\n")
    with pytest.raises(InputError, match=r"index\.csv: lacks the column subject"):
        plan(["walk"], [dress], tmp_path, body, table)


def test_two_clips_for_one_file_are_refused(body: Body, tmp_path: Path) -> None:
    shipped = builtin_clips()["walk"]
    with pytest.raises(InputError, match=rf"walk_tops\.npz: both walk and {shipped}"):
        plan(["walk", str(shipped)], [(join(wear("tops", body), body),)], tmp_path, body)


@pytest.fixture
def finished(carried: Sequence, body: Body, tmp_path: Path) -> Path:
    """A folder in which the sequence of one window is there, so that nothing is left to simulate."""
    (tmp_path / "mine.csv").write_text(HEADER + "walk,a,test,walking,40,30\n")
    out = tmp_path / "out"
    out.mkdir()
    save_sequence(carried, out / "walk_tops.npz")
    simulate_batch(["walk"], ["tops"], out, body, windows=tmp_path / "mine.csv")
    return out


def test_windows_are_kept_with_the_sequences_and_others_are_refused(
    finished: Path, body: Body, tmp_path: Path
) -> None:
    mine = tmp_path / "mine.csv"
    assert (finished / "index.csv").read_text() == mine.read_text()
    simulate_batch(["walk"], ["tops"], finished, body, windows=mine)
    mine.write_text(HEADER + "walk,a,train,walking,40,30\n")
    with pytest.raises(InputError, match=r"out/index\.csv: holds other windows than .*mine\.csv"):
        simulate_batch(["walk"], ["tops"], finished, body, windows=mine)
    assert "test" in (finished / "index.csv").read_text()


def test_what_was_simulated_alone_is_not_taken_for_a_layer(finished: Path, body: Body) -> None:
    with pytest.raises(InputError, match=r"walk_tops\.npz: was simulated as tops, not as bottoms under tops"):
        simulate_batch(["walk"], ["bottoms", "tops"], finished, body, layered=True)


def test_garments_that_would_share_files_or_cross_are_refused(body: Body, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="garment tops: another one is also named tops"):
        simulate_batch(["walk"], ["tops", "tops"], tmp_path, body)
    with pytest.raises(InputError, match=r"garment bottoms: cannot be worn over the garment tops, .* 100 %"):
        simulate_batch(["walk"], ["tops", "bottoms"], tmp_path, body, layered=True)
    assert not list(tmp_path.iterdir())


def test_places_and_numbers_that_cannot_be_are_refused(body: Body, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file: cannot be made a folder"):
        simulate_batch(["walk"], ["tops"], tmp_path / "file", body)
    with pytest.raises(InputError, match="--jobs 0: expected at least 1"):
        simulate_batch(["walk"], ["tops"], tmp_path / "out", body, jobs=0)
    with pytest.raises(InputError, match="--scheduler nowhere: no dask scheduler answers there"):
        simulate_batch(["walk"], ["tops"], tmp_path / "out", body, scheduler="nowhere")
