import resource
import signal
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.thorough import always
from uvcloth.errors import InputError
from uvcloth.writers.animation import Animation, load_animation
from uvcloth.writers.writer import WRITERS, FrameWriter, open_writer


def write(animation: Animation, path: Path, batch: int = 7) -> FrameWriter:
    writer = open_writer(
        path, list(zip(animation.names, animation.meshes, strict=True)), animation.body, 30.0
    )
    with writer:
        for start in range(0, len(animation), batch):
            frames = slice(start, start + batch)
            writer.add(
                tuple(torch.from_numpy(values[frames]) for values in animation.vertices),
                torch.from_numpy(animation.transforms[frames]),
            )
    return writer


def test_unsupported_format_is_refused_before_any_work(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"walk\.fbx.*\.glb, \.usdc, \.usd, \.pc2, \.abc, \.obj, \.npz, \.mp4, \.gif, \.png"
    ):
        open_writer(tmp_path / "new" / "walk.fbx", [], None, 30.0)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", always([".glb", ".obj", ".usdc"], WRITERS))
def test_only_the_finished_files_are_left(animation: Animation, tmp_path: Path, suffix: str) -> None:
    writer = write(animation, tmp_path / f"walk{suffix}")
    assert writer.written
    assert sorted(tmp_path.iterdir()) == sorted(writer.written)


@pytest.mark.parametrize("suffix", WRITERS)
def test_an_interrupt_leaves_nothing_and_keeps_the_old_file(
    animation: Animation, tmp_path: Path, suffix: str
) -> None:
    old = tmp_path / f"walk{suffix}"
    old.write_text("old")

    def interrupted() -> None:
        with open_writer(old, [(animation.names[0], animation.meshes[0])], None, 30.0) as writer:
            writer.add((torch.from_numpy(animation.vertices[0]),))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [part.name for part in tmp_path.iterdir()] == [old.name]
    assert old.read_text() == "old"


@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize("room", ["spool", "file"])
def test_a_full_disk_is_one_sentence_and_leaves_nothing(
    animation: Animation, tmp_path: Path, suffix: str, room: str
) -> None:
    # A limit on the size of files fails the same way as a full disk: write() reports an error.
    spooled = max(values.nbytes for values in animation.vertices)
    limit = spooled // 2 if room == "spool" else spooled + 1000
    if room == "file" and suffix in (".npz", ".pc2", ".obj"):
        pytest.skip("these files are not larger than the spooled frames")
    kept = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, kept[1]))
    try:
        with pytest.raises(InputError, match=rf"walk\{suffix}: cannot be written"):
            write(animation, tmp_path / f"walk{suffix}")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, kept)
        signal.signal(signal.SIGXFSZ, handler)
    assert not list(tmp_path.iterdir())


def test_a_finished_file_appears_only_when_it_is_closed(animation: Animation, tmp_path: Path) -> None:
    writer = open_writer(tmp_path / "a.npz", [("shirt", animation.meshes[0])], None, 30.0)
    writer.add((torch.from_numpy(animation.vertices[0]),))
    writer.finish()
    assert not (tmp_path / "a.npz").exists()
    writer.close()
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_bad_frames_are_refused(animation: Animation, tmp_path: Path) -> None:
    garments = [("shirt", animation.meshes[0])]
    with pytest.raises(InputError, match="no frame"), open_writer(tmp_path / "a.glb", garments, None, 30.0):
        pass
    broken = torch.from_numpy(animation.vertices[0][0]).clone()
    broken[5, 1] = torch.nan
    with pytest.raises(InputError, match="shirt is not a finite"):  # noqa: SIM117
        with open_writer(tmp_path / "a.glb", garments, None, 30.0) as writer:
            writer.add((broken,))
    with pytest.raises(InputError, match="two meshes are called shirt"):
        open_writer(tmp_path / "a.glb", garments * 2, None, 30.0)
    with pytest.raises(InputError, match="two meshes are called Shirt and shirt"):
        open_writer(tmp_path / "a.glb", [*garments, ("Shirt", animation.meshes[0])], None, 30.0)
    assert not list(tmp_path.iterdir())


def test_a_garment_whose_file_windows_cannot_have_is_refused(animation: Animation, tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"walk\.pc2: 'walk-a\?\.pc2' cannot be the name of a file on every system"
    ):
        open_writer(tmp_path / "walk.pc2", [("a?", animation.meshes[0])], None, 30.0)
    assert not list(tmp_path.iterdir())


def test_npz_reads_back_equal(animation: Animation, tmp_path: Path) -> None:
    write(animation, tmp_path / "walk.npz")
    loaded = load_animation(tmp_path / "walk.npz")
    assert loaded.names == animation.names
    assert loaded.fps == 30.0
    np.testing.assert_array_equal(loaded.transforms, animation.transforms)
    for index in range(2):
        np.testing.assert_array_equal(loaded.vertices[index], animation.vertices[index])
        assert torch.equal(loaded.meshes[index].faces, animation.meshes[index].faces)
        assert torch.equal(loaded.meshes[index].face_uvs, animation.meshes[index].face_uvs)
    with pytest.raises(InputError, match="expected an animation"):
        load_animation(Path(__file__))


def test_an_npz_that_names_a_garment_twice_is_refused(animation: Animation, tmp_path: Path) -> None:
    write(animation, tmp_path / "walk.npz")
    with np.load(tmp_path / "walk.npz") as archive:
        arrays = dict(archive)
    arrays["names"] = arrays["names"][[0, 0]]
    np.savez(tmp_path / "twice.npz", **arrays)
    with pytest.raises(InputError, match=r"twice\.npz: names contains a garment twice"):
        load_animation(tmp_path / "twice.npz")
