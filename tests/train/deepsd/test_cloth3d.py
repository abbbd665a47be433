"""DeePSD trains on folders in CLOTH3D's layout, on bodies of SMPL's."""

import sys
from pathlib import Path

import pytest

from rasterize.errors import InputError
from tests.bodies.smpl_file import smpl_arrays, write_npz
from tests.simulate.test_cloth3d import FRAMES, write_sample
from train.__main__ import main
from train.deepsd.dataset import Cloth3DFiles, read_outfits
from uvcloth.checkpoint import load_checkpoint

pytest.importorskip("lightning")


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sample to learn from and one to validate with, and the model file of their bodies."""
    folder = tmp_path_factory.mktemp("cloth3d")
    arrays = smpl_arrays(voxel=0.04)
    write_npz(folder / "female.npz", arrays)
    write_sample(folder / "data" / "train" / "01_01_s1", arrays)
    write_sample(folder / "data" / "val" / "02_01_s1", arrays)
    return folder


def test_its_samples_train(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ["deepsd", "--data", str(root / "data"), "--smpl", str(root / "female.npz"), "--every", "2"]
    rest = ["--out", str(tmp_path / "run"), "--preset", "tiny", "--steps", "2", "--rest-frames", "0"]
    monkeypatch.setattr(sys, "argv", ["train", *arguments, *rest])
    main()
    checkpoint = load_checkpoint(tmp_path / "run")
    assert checkpoint.tensors["poses"].shape == (2 * (FRAMES // 2), 72), "every other frame, and mirrored"
    assert checkpoint.data.clips == {"train": {"01_01_s1": "01"}, "validation": {"02_01_s1": "02"}}


def test_it_needs_model_files(root: Path) -> None:
    with pytest.raises(InputError, match="data: holds samples of CLOTH3D, whose bodies need SMPL's model"):
        read_outfits(root / "data", 0)
    with pytest.raises(InputError, match="--every 0: has to be 1 or more"):
        Cloth3DFiles(every=0)
