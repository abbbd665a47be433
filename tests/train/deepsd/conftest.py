"""Two outfits to learn from and one to validate on, for all tests of DeePSD's training."""

from pathlib import Path

import pytest

from tests.train.deepsd.outfits import MadeUp, save_outfits
from train.deepsd import physics, validation
from train.deepsd.dataset import OutfitDataset, read_outfits

OUTFITS = (
    MadeUp("belt", ("tops",), "train", (0.13, 0.19)),
    MadeUp("hips", ("bottoms", "tops"), "train", (0.05, 0.15), "silk"),
    MadeUp("skirt", ("dress",), "validation", (-0.1, 0.0)),
)


@pytest.fixture(autouse=True)
def _few_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Validation in two poses: each is a copy of the body in the physics phase."""
    monkeypatch.setattr(validation, "POSES", 2)
    monkeypatch.setattr(physics, "POSES", 2)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Their sequences, of six frames, two of them warm-up, on one body."""
    made = tmp_path_factory.mktemp("outfits")
    save_outfits(made, OUTFITS)
    return made


@pytest.fixture(scope="session")
def dataset(folder: Path) -> OutfitDataset:
    """The same as training reads them."""
    return read_outfits([folder], rest_frames=1)
