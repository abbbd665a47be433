"""Samples in CLOTH3D's layout, made up over a made-up body: where cloth and body end up, what is refused."""

import struct
import sys
from collections.abc import Callable
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest
import torch
from scipy.io import loadmat, savemat

from tests.bodies.smpl_file import smpl_arrays, smpl_vertices, write_npz
from train.__main__ import main
from uvcloth.bodies.posing import posed_skin
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.cloth3d import cloth3d_samples, load_cloth3d, read_cloth3d_sample
from uvcloth.errors import InputError
from uvcloth.formats.matlab import read_matlab
from uvcloth.garments.garment import Outfit
from uvcloth.physics.fabric import FABRICS

Arrays = dict[str, np.ndarray]

FRAMES, ZROT = 6, 0.7
BETAS = np.array([0.5, -0.4, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> tuple[Arrays, dict[str, Path]]:
    arrays = smpl_arrays(voxel=0.04)
    path = write_npz(tmp_path_factory.mktemp("smpl") / "female.npz", arrays)
    return arrays, {"female": path}


def poses() -> np.ndarray:
    """Poses (F, 24, 3) of somebody upright in a world with Z up."""
    turns = 0.2 * np.random.default_rng(3).standard_normal((FRAMES, 24, 3))
    turns[:, 0] = [0.5 * np.pi, 0.0, 0.0]
    return turns


TRANS = np.linspace([0.0, 0.5, 1.0], [0.3, -0.5, 1.1], FRAMES)


def turned(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def aligned(arrays: Arrays, pose: np.ndarray) -> np.ndarray:
    """Vertices of the body in a pose, its pelvis at the origin."""
    vertices, joints = smpl_vertices(arrays, BETAS, pose, np.zeros(3))
    return vertices - joints[0]


def patch(arrays: Arrays, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices of the body between two heights of its T, as their numbers, and the faces among them."""
    heights = arrays["v_template"][arrays["f"].astype(int), 1]
    faces = arrays["f"].astype(int)[((heights > low) & (heights < high)).all(1)]
    used, corners = np.unique(faces, return_inverse=True)
    return used, corners.reshape(-1, 3)


def write_cache(path: Path, vertices: np.ndarray, half: bool = True) -> None:
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, vertices.shape[1], 0.0, 1.0, len(vertices))
    path.write_bytes(head + vertices.astype("<f2" if half else "<f4").tobytes())


def write_sample(folder: Path, arrays: Arrays) -> Path:
    """A sample whose garments are patches of the skin itself, so that their places are known."""
    folder.mkdir(parents=True)
    rest = np.zeros((24, 3))
    rest[0, 0], rest[1, 2], rest[2, 2] = 0.5 * np.pi, 0.15, -0.15
    at_rest = aligned(arrays, rest) @ turned(ZROT).T
    moving = np.stack([aligned(arrays, pose) for pose in poses()])
    for name, low, high in (("Tshirt", -0.05, 0.25), ("Trousers", -0.9, -0.1)):
        used, faces = patch(arrays, low, high)
        lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in at_rest[used]]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
        (folder / f"{name}.obj").write_text("\n".join(lines))
        write_cache(folder / f"{name}.pc16", moving[:, used])
    write_info(folder)
    return folder


def write_info(folder: Path, **changes: Any) -> None:
    """Write the facts of a sample; an entry that is changed to None is left out."""
    info = {
        "poses": poses().reshape(FRAMES, 72).T,
        "trans": TRANS.T,
        "shape": BETAS,
        "gender": 0,
        "zrot": ZROT,
        "tightness": [1.0, -0.5],
        "outfit": {
            "Tshirt": {"fabric": "silk", "texture": {"type": "color", "data": [1.0, 0.0, 0.0]}},
            "Trousers": {"fabric": "denim", "texture": {"type": "color", "data": [0.0, 0.0, 1.0]}},
        },
    }
    savemat(folder / "info.mat", {key: value for key, value in (info | changes).items() if value is not None})


@pytest.fixture(scope="module")
def sample(model: tuple[Arrays, dict[str, Path]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_sample(tmp_path_factory.mktemp("data") / "01_05_s2", model[0])


@pytest.fixture(scope="module")
def dressed(sample: Path, model: tuple[Arrays, dict[str, Path]]) -> tuple[Outfit, SimulatedClip]:
    return read_cloth3d_sample(sample, model[1])


def test_a_sample_is_an_outfit_on_a_body(dressed: tuple[Outfit, SimulatedClip]) -> None:
    outfit, clip = dressed
    assert (clip.name, clip.outfit, clip.subject, clip.split) == ("01_05_s2", "01_05_s2", "01", "train")
    # The innermost comes first, whatever the order in the file is.
    assert [clip.kind(garment.name) for garment in clip.garments] == ["trousers", "tshirt"]
    assert [garment.name for garment in outfit.garments] == ["Trousers", "Tshirt"]
    assert [len(garment.mesh.vertices) for garment in outfit.garments] == [
        garment.vertices.shape[1] for garment in clip.garments
    ]
    assert (clip.fps, clip.warm_up, len(clip.vertices)) == (30.0, 0, FRAMES)
    assert clip.transforms.shape == (FRAMES, 24, 3, 4)
    said = clip.metadata
    assert (said["gender"], said["tightness"], said["fabric"]["Tshirt"]) == ("female", [1.0, -0.5], "silk")
    assert [garment.fabric for garment in outfit.garments] == [FABRICS["denim"], FABRICS["silk"]]
    # Samples have files of the same names, which one record of a training holds.
    files = {f"01_05_s2/{name}" for name in ("info.mat", "Trousers.pc16", "Tshirt.pc16")}
    assert set(clip.files) == files


def test_cloth_and_body_are_where_the_data_sets_own_equations_put_them(
    dressed: tuple[Outfit, SimulatedClip], model: tuple[Arrays, dict[str, Path]]
) -> None:
    arrays, _ = model
    outfit, clip = dressed
    body = outfit.body
    assert len(body.mesh.vertices) == len(arrays["v_template"])
    posed = posed_skin(body, clip.transforms).double().numpy()
    for frame, pose in enumerate(poses()):
        world = (aligned(arrays, pose) + TRANS[frame]) @ turned(ZROT).T
        off = np.linalg.norm(posed[frame] - world, axis=1)
        assert off[arrays["weights"].max(1) > 0.9999].max() < 1e-5
        assert off.max() < 4e-3
        for index, (low, high) in enumerate(((-0.9, -0.1), (-0.05, 0.25))):
            used, _ = patch(arrays, low, high)
            cloth = clip.garments[index].vertices[frame].double().numpy()
            assert np.abs(cloth - world[used]).max() < 1e-3  # half floats
            rest = outfit.garments[index].mesh.vertices
            torch.testing.assert_close(rest, body.mesh.vertices[used], atol=5e-6, rtol=0)


def test_fewer_frames_and_full_floats(
    model: tuple[Arrays, dict[str, Path]], dressed: tuple[Outfit, SimulatedClip], tmp_path: Path
) -> None:
    _, clip = dressed
    folder = write_sample(tmp_path / "00012", model[0])
    for name in ("Tshirt", "Trousers"):
        half = np.frombuffer((folder / f"{name}.pc16").read_bytes()[32:], "<f2").reshape(FRAMES, -1, 3)
        (folder / f"{name}.pc16").unlink()
        write_cache(folder / f"{name}.pc2", half, half=False)
    _, found = read_cloth3d_sample(folder, model[1], "test", every=2)
    assert (found.fps, found.subject, found.split) == (15.0, "00012", "test")
    torch.testing.assert_close(found.vertices, clip.vertices[::2])
    torch.testing.assert_close(found.transforms, clip.transforms[::2])


def test_samples_are_found_and_nobody_is_in_two_splits(tmp_path: Path) -> None:
    names = [f"{person:02d}_{trial:02d}_s{trial}" for person in range(10) for trial in range(2)]
    for name in names:
        (tmp_path / name).mkdir()
        (tmp_path / name / "info.mat").touch()
    found = cloth3d_samples(tmp_path)
    assert [folder.name for folder in found] == sorted(names)
    by_person = {
        folder.name[:2]: {split for other, split in found.items() if other.name[:2] == folder.name[:2]}
        for folder in found
    }
    assert all(len(splits) == 1 for splits in by_person.values())
    assert {split for splits in by_person.values() for split in splits} == {"train", "validation", "test"}
    named = tmp_path / "apart" / "val" / "00001"
    named.mkdir(parents=True)
    (named / "info.mat").touch()
    assert cloth3d_samples(tmp_path / "apart") == {named: "validation"}
    with pytest.raises(InputError, match="nothing: holds no sample of CLOTH3D"):
        cloth3d_samples(tmp_path / "nothing")


def test_training_starts_with_a_folder_of_samples(
    sample: Path,
    model: tuple[Arrays, dict[str, Path]],
    dressed: tuple[Outfit, SimulatedClip],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("train/00001", "val/00002"):
        copytree(sample, tmp_path / "data" / name)
    words = "train deepsd --preset tiny --steps 1 --validate-every 1 --data"
    monkeypatch.setattr(sys, "argv", [*words.split(), str(tmp_path / "data"), "--out", str(tmp_path / "run")])
    with pytest.raises(InputError, match=r"data: lacks smpl/model_f and model_m"):
        load_cloth3d(tmp_path / "data")
    (tmp_path / "data" / "smpl").mkdir()
    (tmp_path / "data" / "smpl" / "model_f.npz").symlink_to(model[1]["female"])
    ((outfit, clip),) = load_cloth3d(tmp_path / "data", ("validation",), every=3)
    assert (clip.name, clip.split) == ("00002", "validation")
    torch.testing.assert_close(clip.vertices, dressed[1].vertices[::3])
    # Bodies of one model share the largest of what they hold.
    assert outfit.body.pose_shapes is load_cloth3d(tmp_path / "data")[0][0].body.pose_shapes
    main()
    assert (tmp_path / "run" / "model.safetensors").is_file()


def cut(path: Path, count: int) -> None:
    path.write_bytes(path.read_bytes()[:count])


def without_vertex(folder: Path) -> None:
    lines = (folder / "Tshirt.obj").read_text().splitlines()
    (folder / "Tshirt.obj").write_text("\n".join(["v 0 0 0", *lines]))


def all_in_one_place(folder: Path) -> None:
    lines = (folder / "Tshirt.obj").read_text().splitlines()
    same = ["v 1 1 1" if line.startswith("v ") else line for line in lines]
    (folder / "Tshirt.obj").write_text("\n".join(same))


def with_nan(folder: Path) -> None:
    path = folder / "Tshirt.pc16"
    content = bytearray(path.read_bytes())
    content[-2:] = b"\xff\xff"
    path.write_bytes(content)


def more_frames(folder: Path) -> None:
    path = folder / "Tshirt.pc16"
    content = bytearray(path.read_bytes())
    content[28:32] = struct.pack("<i", FRAMES + 1)
    path.write_bytes(content)


DAMAGES: dict[str, Callable[[Path], Any]] = {
    r"01_05_s2: lacks info\.mat": lambda folder: (folder / "info.mat").unlink(),
    r"info\.mat: not a readable MATLAB file": lambda folder: cut(folder / "info.mat", 700),
    r"01_05_s2: lacks Tshirt\.obj": lambda folder: (folder / "Tshirt.obj").unlink(),
    r"01_05_s2: lacks Tshirt\.pc16": lambda folder: (folder / "Tshirt.pc16").unlink(),
    r"Tshirt\.obj: has no faces": lambda folder: (folder / "Tshirt.obj").write_text("v 0 0 0\n"),
    r"Tshirt\.obj, line 1: not a readable OBJ": lambda folder: (folder / "Tshirt.obj").write_text(
        "v a b c\n"
    ),
    r"Tshirt\.obj: its edges are 0 mm long on average": all_in_one_place,
    r"Tshirt\.pc16: its header gives 6 frames, but the file has 5 complete": lambda folder: cut(
        folder / "Tshirt.pc16", -40
    ),
    r"Tshirt\.pc16: not a point cache": lambda folder: cut(folder / "Tshirt.pc16", 20),
    r"Tshirt\.pc16: has \d+ vertices, but Tshirt\.obj has \d+": without_vertex,
    r"Tshirt\.pc16: has 7 frames, but info\.mat has 6": more_frames,
    r"Tshirt\.pc16: a vertex of frame 5 is not a finite number": with_nan,
}


@pytest.mark.parametrize("said", DAMAGES)
def test_what_is_missing_or_damaged_is_one_sentence(
    sample: Path, model: tuple[Arrays, dict[str, Path]], tmp_path: Path, said: str
) -> None:
    folder = copytree(sample, tmp_path / sample.name)
    DAMAGES[said](folder)
    with pytest.raises(InputError, match=said) as caught:
        read_cloth3d_sample(folder, model[1])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"poses": None}, "lacks poses"),
        ({"poses": np.zeros((66, FRAMES))}, r"poses has the shape \(66, 6\), expected \(72, frames\)"),
        ({"trans": np.zeros((3, 4))}, "has 6 poses and 4 root positions"),
        ({"trans": np.full((3, FRAMES), np.nan)}, "trans holds a value that is not a finite number"),
        ({"shape": np.zeros(40)}, "shape: female: has 10 shape parameters, 40 were given"),
        ({"gender": 2}, "gender is 2"),
        ({"gender": 1}, "the person is male, but the male model of SMPL is missing"),
        ({"outfit": None}, "lacks the outfit"),
        ({"outfit": {"Tshirt": 1}}, "lacks the outfit"),
        ({"zrot": "left"}, "zrot holds no numbers"),
    ],
)
def test_a_faulty_info_is_one_sentence(
    sample: Path, model: tuple[Arrays, dict[str, Path]], tmp_path: Path, changes: dict[str, Any], said: str
) -> None:
    folder = copytree(sample, tmp_path / sample.name)
    write_info(folder, **changes)
    with pytest.raises(InputError, match=said) as caught:
        read_cloth3d_sample(folder, model[1])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("compressed", [False, True])
def test_a_matlab_file_is_read_as_scipy_reads_it(compressed: bool, tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    numbers = {
        f"a{index}": (100 * random.standard_normal(shape)).astype(kind)
        for index, kind in enumerate(("f4", "f8", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"))
        for shape in ((3, 4),)
    }
    cloth = {"fabric": "silk", "length": 2.5, "inner": {"flat": [1, 2, 3]}}
    written = {
        **numbers,
        "one": 7,
        "cube": np.arange(24.0).reshape(2, 3, 4),
        "no": np.zeros((0, 3)),
        "s": cloth,
    }
    savemat(tmp_path / "a.mat", written, do_compression=compressed, long_field_names=True)
    expected = loadmat(tmp_path / "a.mat", simplify_cells=True)
    found = read_matlab(tmp_path / "a.mat")
    assert found.keys() == {name for name in expected if not name.startswith("__")}
    for name, value in found.items():
        if name != "s":
            assert value.shape == np.shape(expected[name])
            np.testing.assert_array_equal(value, expected[name])
    assert found["s"]["fabric"] == "silk"
    assert found["s"]["inner"]["flat"].tolist() == [1, 2, 3]


def test_a_garment_is_no_path_to_another_folder(
    sample: Path, model: tuple[Arrays, dict[str, Path]], tmp_path: Path
) -> None:
    folder = copytree(sample, tmp_path / sample.name)
    path = folder / "info.mat"
    path.write_bytes(path.read_bytes().replace(b"Tshirt", b"../../"))
    with pytest.raises(InputError, match=r"info\.mat: not a readable MATLAB file \(the name '\.\./\.\./'"):
        read_cloth3d_sample(folder, model[1])


def test_another_model_than_smpl_is_refused(sample: Path, tmp_path: Path) -> None:
    other = write_npz(tmp_path / "hands.npz", smpl_arrays("SMPL-H", voxel=0.06))
    with pytest.raises(InputError, match=r"hands\.npz: is a model of SMPL-H"):
        read_cloth3d_sample(sample, {"female": other})
