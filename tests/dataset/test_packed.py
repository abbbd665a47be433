"""Packed folders: what comes out again, what is refused, and that a rerun does the rest."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.dataset.altered import altered
from tests.small_body import small_body
from uvcloth import cli
from uvcloth.bodies.body import save_body
from uvcloth.dataset.bodies import folder_body, keep_body, sequence_body
from uvcloth.dataset.clip import SimulatedClip, clip_of_garment, flat_metadata
from uvcloth.dataset.clip_file import load_simulated, save_simulated
from uvcloth.dataset.folder import keep_refused, refused_captures, stored_sequences
from uvcloth.dataset.packed import PackedFolder, load_packed, pack_folder, unpack_folder
from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays
from uvcloth.geometry.rotations import from_axis_angles
from uvcloth.geometry.skeleton import joint_transforms

FRAMES = 40
INDEX = "trial,subject,split,action,window_start,window_frames\n01_01,a,train,walk,0,1000\n"


def sequence(garment: str = "tops", **said: object) -> SimulatedClip:
    """A box that walks 12 m and turns around twice in a second, in cloth that swings around it."""
    body = small_body()
    time = torch.linspace(0.0, 1.0, FRAMES)[:, None]
    spin = torch.cat([0 * time, 0 * time, 4.0 * torch.pi * time], dim=1)
    rotations = from_axis_angles(torch.stack([spin, 0.9 * spin], dim=1))
    transforms = joint_transforms(
        body.skeleton, rotations, torch.cat([12.0 * time, 0 * time, 0 * time], dim=1)
    )
    rest = body.mesh.vertices
    swing = 0.05 * torch.sin(9.0 * time + rest[:, 0])[..., None]
    vertices = (transforms[:, :1, :, :3] @ (rest + swing)[..., None]).squeeze(-1) + transforms[:, :1, :, 3]
    shape = {"body": "box", "body_hash": body.identity.shape, "engine": "newton.X"}
    metadata = {"clip": "01_01", "garment": garment, **shape, **said}
    return clip_of_garment(vertices, body.mesh.faces, rest, transforms, 30.0, 5, metadata)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for garment in ("tops", "dress"):
        save_simulated(sequence(garment), tmp_path / "data" / f"01_01_{garment}.npz")
    keep_body(small_body(), tmp_path / "data")
    (tmp_path / "data" / "index.csv").write_text(INDEX)
    return tmp_path / "data"


def require_within(before: SimulatedClip, after: SimulatedClip, error: float) -> None:
    """Check the errors that packing promises; on top come 0.05 mm of a sequence's file and rounding."""
    off = (before.vertices - after.vertices).norm(dim=-1)
    slack = 1e-4
    assert float(off.mean()) < error + slack
    assert float(off.flatten().quantile(0.99)) < 3.0 * error + slack
    assert float(off.max()) < 6.0 * error + slack


def test_what_is_unpacked_is_what_was_packed_to_a_millimetre(folder: Path, tmp_path: Path) -> None:
    assert pack_folder(folder, tmp_path / "packed") == 2
    assert unpack_folder(tmp_path / "packed", tmp_path / "again") == 2
    for name in ("01_01_tops.npz", "01_01_dress.npz"):
        before, after = load_simulated(folder / name), load_simulated(tmp_path / "again" / name)
        require_within(before, after, 1e-3)
        torch.testing.assert_close(after.transforms, before.transforms, atol=4e-4, rtol=0)
        (garment,), (original,) = after.garments, before.garments
        assert torch.equal(garment.faces, original.faces)
        assert torch.equal(garment.rest, original.rest)
        assert (after.fps, after.warm_up) == (before.fps, before.warm_up)
        own = ("hash", "packed_error")
        assert {k: v for k, v in flat_metadata(after, garment).items() if k not in own} == {
            k: v for k, v in flat_metadata(before, original).items() if k not in own
        }
        assert garment.metadata["packed_error"] == 1e-3
    assert (tmp_path / "again" / "index.csv").read_text() == INDEX
    assert len(stored_sequences(tmp_path / "again")) == 2
    assert torch.equal(folder_body(tmp_path / "again").mesh.vertices, small_body().mesh.vertices)


def test_outfits_are_packed_with_their_bodies(folder: Path, tmp_path: Path) -> None:
    """Each garment has a mesh of its own, and two of them a body of their own."""
    stout = replace(small_body(scale=1.2), name="stout")
    keep_body(stout, folder)
    made = {"outfit": "o1", "split": "train", "layers": ["o1_skirt", "o1_top"]}
    for garment in made["layers"]:
        on = {"body": stout.name, "body_hash": stout.identity.shape}
        wider = sequence(garment, **made, **on)
        save_simulated(altered(wider, rest=1.2 * wider.garments[0].rest), folder / f"01_01_{garment}.npz")
    assert pack_folder(folder, tmp_path / "packed") == 4
    assert unpack_folder(tmp_path / "packed", tmp_path / "again") == 4
    after = load_simulated(tmp_path / "again" / "01_01_o1_skirt.npz")
    assert after.outfit == "o1"
    assert after.layers == ("o1_skirt", "o1_top")
    body = sequence_body(tmp_path / "again" / "01_01_o1_skirt.npz", after.metadata, {})
    assert torch.equal(body.mesh.vertices, stout.mesh.vertices)
    with pytest.raises(InputError, match="other files of its folder on box"):
        folder_body(tmp_path / "again")


def test_a_rerun_does_what_is_missing(folder: Path, tmp_path: Path) -> None:
    packed = tmp_path / "packed"
    pack_folder(folder, packed)
    assert pack_folder(folder, packed) == 0
    (packed / "01_01_tops.npz").unlink()
    keep_refused({"05_01": "stands still"}, folder)
    assert pack_folder(folder, packed) == 1
    assert refused_captures(packed) == {"05_01": "stands still"}
    assert unpack_folder(packed, tmp_path / "again") == 2
    assert unpack_folder(packed, tmp_path / "again") == 0
    (folder / "index.csv").write_text(INDEX.replace("1000", "900"))
    with pytest.raises(InputError, match=r"packed/index.csv: holds other windows"):
        pack_folder(folder, packed)


def run(monkeypatch, *arguments: object) -> int:
    monkeypatch.setattr("sys.argv", ["uvcloth", "data", *map(str, arguments)])
    return cli.main()


def test_the_command_packs_and_unpacks(folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    packed, again = tmp_path / "packed", tmp_path / "again"
    assert run(monkeypatch, folder, "--pack", packed) == 0
    assert run(monkeypatch, packed, "--unpack", again) == 0
    assert f"{packed}: 2 sequences packed\n{again}: 2 sequences unpacked\n" in capsys.readouterr().out
    assert run(monkeypatch, folder, "--pack", packed, "--unpack", again) == 2
    assert "give --pack, --unpack or --export" in capsys.readouterr().err


def test_members_of_an_ensemble_share_meshes_and_motions(folder: Path, tmp_path: Path) -> None:
    packed, again = tmp_path / "packed", tmp_path / "again"
    member = sequence("dress")
    save_simulated(member, folder / "members" / "1" / "01_01_dress.npz")
    keep_body(small_body(), folder / "members" / "1")
    assert pack_folder(folder, packed) == 3
    files = sorted(
        path.relative_to(packed / "members").as_posix() for path in packed.glob("members/**/*.npz")
    )
    assert files == ["1/01_01_dress.npz", "1/bodies/box.npz"]
    assert unpack_folder(packed, again) == 3
    assert pack_folder(folder, folder / "kept") == 3
    assert pack_folder(folder, folder / "kept") == 0
    require_within(member, load_simulated(again / "members" / "1" / "01_01_dress.npz"), 1e-3)


def test_what_cannot_be_packed_is_refused_by_its_file(folder: Path, tmp_path: Path) -> None:
    packed = tmp_path / "packed"
    with pytest.raises(InputError, match=r"none: no such folder"):
        pack_folder(tmp_path / "none", packed)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"empty: no sequence"):
        pack_folder(tmp_path / "empty", packed)
    save_body(small_body(scale=1.1), folder / "bodies" / "box.npz")
    with pytest.raises(InputError, match=r"01_01_dress.npz: was simulated on the body box, which is neither"):
        pack_folder(folder, packed)
    save_body(small_body(), folder / "bodies" / "box.npz")
    with pytest.raises(InputError, match=r"bodies/..: is the input folder itself"):
        pack_folder(folder, folder / "bodies" / "..")
    other = sequence()
    wider = altered(other, rest=1.01 * other.garments[0].rest)
    save_simulated(wider, folder / "01_03_tops.npz")
    with pytest.raises(InputError, match=r"01_03_tops.npz: tops has another mesh there than"):
        pack_folder(folder, packed)


@pytest.mark.parametrize("error", [1e-3, 2e-4])
def test_errors_are_those_that_are_allowed(error: float, folder: Path, tmp_path: Path) -> None:
    assert pack_folder(folder, tmp_path / "packed", error) == 2
    after = load_packed(tmp_path / "packed" / "01_01_tops.npz", PackedFolder(tmp_path / "packed"))
    require_within(load_simulated(folder / "01_01_tops.npz"), after, error)
    assert after.garments[0].metadata["packed_error"] == error
    with pytest.raises(InputError, match=r"--error 1000: expected 0.01 to 100 mm"):
        pack_folder(folder, tmp_path / "packed", 1.0)


def test_garments_of_a_clip_share_its_motion(folder: Path, tmp_path: Path) -> None:
    pack_folder(folder, tmp_path / "packed")
    assert len(list((tmp_path / "packed" / "motions").iterdir())) == 1
    save_simulated(replace(sequence("shirt"), warm_up=6), folder / "01_01_shirt.npz")
    assert pack_folder(folder, tmp_path / "packed") == 1
    assert len(list((tmp_path / "packed" / "motions").iterdir())) == 2


def test_packing_again_gives_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    for name in ("packed", "again"):
        pack_folder(folder, tmp_path / name)
    files = [path.relative_to(tmp_path / "packed") for path in (tmp_path / "packed").rglob("*.npz")]
    assert len(files) == 6
    for path in files:
        assert (tmp_path / "packed" / path).read_bytes() == (tmp_path / "again" / path).read_bytes()


def damage(path: Path, format: str, name: str, place: int) -> None:
    arrays = load_arrays(path, format, "")
    arrays[name].reshape(-1)[place] ^= 64
    save_arrays(path, arrays)


def test_a_damaged_file_is_refused(folder: Path, tmp_path: Path) -> None:
    packed, again = tmp_path / "packed", tmp_path / "again"
    pack_folder(folder, packed)
    damage(packed / "01_01_tops.npz", "uvcloth-packed-2", "cloth", 200)
    with pytest.raises(InputError, match=r"01_01_tops.npz: its code is damaged or belongs to other numbers"):
        unpack_folder(packed, again)
    assert not (again / "01_01_tops.npz").exists()
    motion = next((packed / "motions").iterdir())
    damage(motion, "uvcloth-packed-motion-2", "code", 100)
    with pytest.raises(InputError, match=f"{motion.name}: its code is damaged .* 40 frames of 2 joints"):
        unpack_folder(packed, again / "other")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"motion": "../../01_01"}, "names the motion '../../01_01', expected 16 hexadecimal digits"),
        ({"motion": "0" * 16}, "0000000000000000.npz: "),
        ({"step": 100.0}, "the description has the step 100"),
        ({"error": 0.0}, "the description has the error 0"),
        ({"step": "1"}, "the description"),
        ({"metadata": {"clip": "01_01"}}, "the metadata"),
    ],
)
def test_a_wrong_description_is_refused(
    change: dict[str, object], words: str, folder: Path, tmp_path: Path
) -> None:
    packed = tmp_path / "packed"
    pack_folder(folder, packed)
    path = packed / "01_01_tops.npz"
    arrays = load_arrays(path, "uvcloth-packed-2", "")
    arrays["description"] = np.array(json.dumps(json.loads(str(arrays["description"])) | change))
    save_arrays(path, arrays)
    with pytest.raises(InputError, match=re.escape(words)):
        load_packed(path, PackedFolder(packed))


def test_files_that_do_not_belong_together_are_refused(folder: Path, tmp_path: Path) -> None:
    packed = tmp_path / "packed"
    pack_folder(folder, packed)
    with pytest.raises(InputError, match=r"expected a sequence packed by `uvcloth data --pack`"):
        unpack_folder(folder, tmp_path / "again")
    with pytest.raises(InputError, match=r"expected a sequence made by this version of `uvcloth simulate`"):
        load_simulated(packed / "01_01_tops.npz")
    mesh = load_arrays(packed / "meshes" / "tops.npz", "uvcloth-mesh-2", "")
    save_arrays(packed / "meshes" / "tops.npz", {**mesh, "faces": np.roll(mesh["faces"], 1, axis=0)[:-4]})
    with pytest.raises(InputError, match=r"01_01_tops.npz: does not unpack to the data that was packed"):
        unpack_folder(packed, tmp_path / "again")
    (packed / "meshes" / "tops.npz").unlink()
    with pytest.raises(InputError, match=r"meshes/tops.npz: "):
        unpack_folder(packed, tmp_path / "again")
