"""Readers of CLOTH3D's samples: MATLAB files, point caches and the folder that holds them."""

import struct
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import torch
from scipy.io import savemat

from tests.fuzz.array_targets import check_mesh
from tests.fuzz.smpl_targets import good_npz
from tests.fuzz.target import Target, require, require_numbers
from tests.small_body import small_body
from uvcloth.dataset.clip import SimulatedClip
from uvcloth.dataset.cloth3d import read_cloth3d_sample
from uvcloth.formats.matlab import Value, read_matlab
from uvcloth.garments.garment import Outfit

FRAMES = 4
INFO = {
    "poses": 0.1 * np.ones((72, FRAMES)),
    "trans": np.zeros((3, FRAMES)),
    "shape": np.zeros(10),
    "gender": 0,
    "zrot": 0.5,
    "outfit": {"Top": {"fabric": "silk", "texture": {"type": "color", "data": [1.0, 0.0, 0.0]}}},
}


@cache
def model() -> Path:
    """A model of SMPL, beside the samples: its own reader is another target."""
    return good_npz(Path(mkdtemp(prefix="smpl")))


def good_info(folder: Path) -> Path:
    savemat(folder / "info.mat", INFO)
    return folder / "info.mat"


def packed_info(folder: Path) -> Path:
    savemat(folder / "info.mat", INFO, do_compression=True)
    return folder / "info.mat"


def check_info(found: dict[str, Value]) -> None:
    for name, value in found.items():
        require(name.isidentifier(), f"the name {name!r}")
        require(value is None or isinstance(value, np.ndarray | str | dict), f"{name} is a {type(value)}")
        if isinstance(value, np.ndarray):
            require(value.dtype.kind in "fiu" and value.dtype.isnative, f"{name} is {value.dtype}")
        if isinstance(value, dict):
            check_info(value)


def good_sample(folder: Path) -> Path:
    sample = folder / "01_02_s3"
    sample.mkdir()
    packed_info(sample)
    mesh = small_body().mesh
    lines = [f"v {x:.3f} {y:.3f} {z:.3f}" for x, y, z in (1.1 * mesh.vertices).tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (mesh.faces + 1).tolist()]
    (sample / "Top.obj").write_text("\n".join(lines))
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, len(mesh.vertices), 0.0, 1.0, FRAMES)
    moved = mesh.vertices.numpy() + np.zeros((FRAMES, 1, 1))
    (sample / "Top.pc16").write_bytes(head + moved.astype("<f2").tobytes())
    return sample


def check_sample(sample: tuple[Outfit, SimulatedClip]) -> None:
    outfit, clip = sample
    count = sum(len(garment.mesh.vertices) for garment in outfit.garments)
    require(count > 0 and sum(len(garment.rest) for garment in clip.garments) == count, "other sizes")
    require_numbers(clip.vertices, (-1, count, 3), "vertices")
    require(len(clip.vertices) > 0, "no frames")
    require_numbers(clip.transforms, (len(clip.vertices), 24, 3, 4), "transforms")
    require(clip.fps == 30.0 and clip.subject == "01", "frame rate, or person")
    check_mesh(outfit.body.mesh, "body")
    for garment in outfit.garments:
        check_mesh(garment.mesh, garment.name)
        require(torch.isfinite(garment.weights).all(), "weights that are not finite")


TARGETS = [
    Target("matlab", good_info, read_matlab, check_info),
    Target("matlab_packed", packed_info, read_matlab, check_info),
    Target("cloth3d", good_sample, lambda path: read_cloth3d_sample(path, {"female": model()}), check_sample),
]
