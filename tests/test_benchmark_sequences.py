"""The packed sequences in `benchmarks`: they unpack here as where they were packed."""

import csv
import hashlib
from pathlib import Path

import pytest
import torch

from uvcloth.bodies.body import load_body
from uvcloth.dataset.bodies import keep_body
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.clip_file import load_simulated, save_simulated
from uvcloth.dataset.packed import MEAN_ERROR, PackedFolder, load_packed, pack_folder
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.skinning import skin
from uvcloth.motion.index import read_index
from uvcloth.physics.measures import edge_change

BENCHMARKS = Path(__file__).parent.parent / "benchmarks"
FOLDER, REFERENCE = BENCHMARKS / "simulated", BENCHMARKS / "reference"
TEMPLATES = ("tops", "bottoms", "dress", "shirt", "skirt", "jacket")


def read_plan() -> list[dict[str, str]]:
    with (BENCHMARKS / "plan.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def sequence() -> SimulatedClip:
    return load_packed(REFERENCE / "26_01_bottoms.npz", PackedFolder(REFERENCE))


@pytest.mark.thorough
def test_a_sequence_is_cloth_on_a_body(sequence: SimulatedClip) -> None:
    """One garment's: a file that does not unpack to what was packed is refused, with any LAPACK."""
    garment = load_garment("bottoms", load_body())
    (simulated,) = sequence.garments
    assert torch.equal(simulated.faces, garment.mesh.faces)
    torch.testing.assert_close(simulated.rest, garment.mesh.vertices)
    scored = slice(sequence.warm_up, None, 10)
    skinned = skin(simulated.rest, garment.smooth_weights, sequence.transforms[scored])
    apart = (sequence.vertices[scored] - skinned).norm(dim=-1)
    assert 0.005 < float(apart.mean()) < 0.05
    assert float(edge_change(sequence.vertices[scored], simulated.rest, simulated.faces).mean()) < 1.5e-3


@pytest.mark.thorough
def test_real_cloth_is_packed_within_the_error(tmp_path: Path) -> None:
    """Of a made outfit, which has half the vertices of a template: a spectrum takes an eighth of the time."""
    folder, path = BENCHMARKS / "outfits", tmp_path / "data" / "12_01_o0019_tshirt.npz"
    shared = PackedFolder(folder)
    sequence = load_packed(folder / path.name, shared)
    save_simulated(sequence, path)
    for body in shared.bodies.values():
        keep_body(body, path.parent)
    assert pack_folder(path.parent, tmp_path / "packed") == 1
    packed = tmp_path / "packed" / path.name
    assert packed.stat().st_size < path.stat().st_size / 10
    after = load_packed(packed, PackedFolder(packed.parent))
    off = (after.vertices - load_simulated(path).vertices).norm(dim=-1).flatten()
    assert float(off.mean()) < MEAN_ERROR
    assert float(off.kthvalue(int(0.99 * len(off))).values) < 3.0 * MEAN_ERROR
    assert float(off.max()) < 6.01 * MEAN_ERROR
    torch.testing.assert_close(after.transforms, sequence.transforms, atol=4e-4, rtol=0)


def test_nobody_is_in_two_splits() -> None:
    plan = read_plan()
    names = {path.stem for folder in (FOLDER, REFERENCE) for path in folder.glob("*.npz")}
    assert names <= {f"{row['name']}_{row['garments']}" for row in plan}
    index = read_index(FOLDER / "index.csv")
    clips = {name.rpartition("_")[0] for name in names}
    splits = {
        split: {index[clip].subject for clip in clips if index[clip].split == split}
        for split in ("train", "validation", "test")
    }
    assert all(splits.values())
    assert sum(map(len, splits.values())) == len(set.union(*splits.values()))
    assert {path.stem for path in (FOLDER / "meshes").glob("*.npz")} == set(TEMPLATES)


def test_methods_are_judged_on_windows_that_none_was_trained_on() -> None:
    index = read_index(REFERENCE / "index.csv")
    assert {index[path.stem.rpartition("_")[0]].split for path in REFERENCE.glob("*.npz")} == {
        "validation",
        "test",
    }


def test_the_bodies_of_the_plan_are_there() -> None:
    planned = {row["body"] for row in read_plan()} - {""}
    assert planned == {f"bodies/{path.name}" for path in (BENCHMARKS / "bodies").glob("*.npz")}
    for body in planned:
        assert load_body(BENCHMARKS / body).name == Path(body).stem


@pytest.mark.thorough
def test_made_outfits_lie_beside_them() -> None:
    """Each on the body that its sequence names, over a clip of its own split."""
    folder = BENCHMARKS / "outfits"
    people = {row["clip"]: (row["split"], row["subject"]) for row in read_plan()}
    for name in ("12_01_o0019_tshirt", "26_01_o0018_skirt", "16_08_o0001_shorts"):
        shared = PackedFolder(folder)
        sequence = load_packed(folder / f"{name}.npz", shared)
        assert (sequence.split, sequence.subject) == people[name.rpartition("_o")[0]]
        (garment,) = sequence.garments
        assert name.endswith(f"{sequence.outfit}_{sequence.kind(garment.name)}")
        (body,) = shared.bodies.values()
        assert body.name == sequence.metadata["body"]
        assert (garment.rest - body.mesh.vertices.mean(0)).norm(dim=1).max() < 1.5


@pytest.mark.parametrize("name", ["bodies", "outfits", "reference", "simulated"])
def test_every_folder_says_what_it_is_and_lists_the_checksums_of_all_its_files(name: str) -> None:
    folder = BENCHMARKS / name
    page = (folder / "README.md").read_text(encoding="utf-8")
    assert all(word in page for word in ("uvcloth data", "November 2026", "SHA256SUMS"))
    assert "CMU Graphics Lab" in page or "simulated/README.md" in page
    lines = (folder / "SHA256SUMS").read_text(encoding="utf-8").splitlines()
    listed = {path: digest for digest, path in (line.split("  ./") for line in lines)}
    files = {path for path in folder.rglob("*") if path.suffix in {".npz", ".csv"}}
    assert listed == {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files
    }
