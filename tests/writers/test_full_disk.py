"""A disk that is full or read-only is one sentence with the system's reason, for every kind of file."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from evaluate.report import write_metrics
from rasterize.exr import write_exr
from tests.small_disk import BALLAST, leave_room, protect, small_disk
from tests.thorough import always
from uvcloth.bodies.body import save_body
from uvcloth.checkpoint import save_tensors
from uvcloth.errors import InputError
from uvcloth.files.archive import save_arrays
from uvcloth.files.atomic import sole_writer
from uvcloth.files.image import atomic_image, write_png
from uvcloth.garments.garment import Outfit
from uvcloth.methods.pbns.method import PBNS
from uvcloth.motion.clip import Clip
from uvcloth.writers.animation import Animation
from uvcloth.writers.gltf_rig import write_rig_glb
from uvcloth.writers.obj import save_obj
from uvcloth.writers.rig import rig_of
from uvcloth.writers.usd_rig import write_rig_usd
from uvcloth.writers.video import open_video
from uvcloth.writers.writer import WRITERS, open_writer

FRAMES = 6
FULL = r"cannot be written \(No space left on device\)"

NOISE = np.random.default_rng(0).random((300, 300))


def write_noise(path: Path) -> None:
    with atomic_image(path) as partial:
        write_exr(partial, {"noise": NOISE.astype(np.float32)})


SMALL: dict[str, Callable[[Path, Animation], None]] = {
    "a.npz": lambda path, _: save_arrays(path, {"noise": NOISE}),
    "a.exr": lambda path, _: write_noise(path),
    "a.png": lambda path, _: write_png(path, np.stack([NOISE] * 3, -1)),
    "a.obj": lambda path, animation: save_obj(animation.meshes[0], path),
    "a.safetensors": lambda path, _: save_tensors({"noise": torch.from_numpy(NOISE)}, {}, path),
    "metrics.json": lambda path, _: write_metrics(path.parent, {"noise": NOISE.tolist()}) and None,
    "body.npz": lambda path, animation: animation.body and save_body(animation.body, path),
}
"""Writers of single files."""


@pytest.fixture(scope="module")
def disk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    with small_disk(tmp_path_factory.mktemp("small") / "disk") as mounted:
        yield mounted


def write(animation: Animation, path: Path) -> None:
    garments = list(zip(animation.names, animation.meshes, strict=True))
    with open_writer(path, garments, animation.body, 30.0) as writer:
        vertices = tuple(torch.from_numpy(values[:FRAMES]) for values in animation.vertices)
        writer.add(vertices, torch.from_numpy(animation.transforms[:FRAMES]))


def left(disk: Path) -> list[str]:
    return sorted(path.name for path in disk.iterdir())


@pytest.mark.parametrize("suffix", always([".usdc", ".obj", ".npz"], WRITERS))
def test_an_animation_for_which_the_disk_is_too_small(animation: Animation, disk: Path, suffix: str) -> None:
    spool = sum(values[:FRAMES].nbytes for values in (*animation.vertices, animation.transforms))
    for room in (0, spool // 2, int(1.1 * spool) + 16384):
        leave_room(disk, room)
        with pytest.raises(InputError, match=rf"disk/walk[^/]*: {FULL}"):
            write(animation, disk / f"walk{suffix}")
        assert left(disk) == [BALLAST]


@pytest.mark.parametrize("name", SMALL)
def test_a_file_for_which_the_disk_is_too_small(animation: Animation, disk: Path, name: str) -> None:
    for room in (0, 16384):
        leave_room(disk, room)
        with pytest.raises(InputError, match=f"{name}: {FULL}"):
            SMALL[name](disk / name, animation)
        assert left(disk) == [BALLAST]


@pytest.mark.parametrize("write_rig", [write_rig_glb, write_rig_usd])
def test_a_rig_for_which_the_disk_is_too_small(
    pbns: PBNS, outfit: Outfit, clip: Clip, disk: Path, write_rig: Callable
) -> None:
    pose_rig = pbns.as_rig(outfit.body, outfit.garments)
    assert pose_rig is not None
    rig = rig_of(pose_rig, outfit.body, clip, 4, False).rig
    leave_room(disk, 40960)
    with pytest.raises(OSError, match="No space left on device"):
        write_rig(rig, disk / ("r.glb" if write_rig is write_rig_glb else "r.usdc"))


@pytest.mark.parametrize("name", ["a.mp4", "a.gif"])
def test_a_video_for_which_the_disk_is_too_small(disk: Path, name: str) -> None:
    pytest.importorskip("av", reason="PyAV is not installed")
    leave_room(disk, 4096)
    random = np.random.default_rng(0)

    def draw() -> None:
        video = open_video(disk / name, (64, 64), 30.0)
        for _ in range(10):
            video.add(random.integers(0, 255, (64, 64, 3), np.uint8))
        video.close()

    with pytest.raises(OSError, match="No space left on device"):
        draw()


def test_a_read_only_disk(animation: Animation, tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", 1) as disk:
        protect(disk)
        for name in ("walk.glb", "new/walk.usdc"):
            with pytest.raises(InputError, match=r"cannot be .* \(Read-only file system\)"):
                write(animation, disk / name)
        with pytest.raises(InputError, match=r"cannot be written \(Read-only file"), sole_writer(disk):
            pass
