"""The poses of both splits that an outfit is settled in."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from tests.train.simulated import database_of
from train.pbns.supervision import SupervisionConfig, settle_poses
from train.settled import SETTLED_FILE, SettledOutfit
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.physics.fabric import find_fabric


def test_poses_of_both_splits_are_settled_in_the_fabric_of_the_training(
    body: Body, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outfit = Outfit(body, (fit_template("tops", body),))
    database, silk = database_of(body), find_fabric("silk")
    asked: list[tuple[Outfit, Tensor, Path]] = []

    def stand_in(outfit: Outfit, transforms: Tensor, path: Path) -> SettledOutfit:
        asked.append((outfit, transforms, path))
        rows = torch.tensor([0, 2, 3])
        return SettledOutfit(rows, rows[:, None, None].expand(-1, 5, 3).float(), len(transforms))

    monkeypatch.setattr("train.pbns.supervision.settled_outfit", stand_in)
    config = SupervisionConfig(settled=3)
    supervision = settle_poses(config, outfit, silk, database, tmp_path)
    ((settled, transforms, path),) = asked
    assert path == tmp_path / SETTLED_FILE
    assert [garment.fabric for garment in settled.garments] == [silk]
    every = {split: database.of(split).transforms(body.skeleton) for split in ("train", "validation")}
    torch.testing.assert_close(transforms, torch.cat([every["train"][[0, 2, 5]], every["validation"][[0]]]))
    assert supervision is not None
    assert supervision.training.rows.tolist() == [0, 5]
    assert supervision.training.vertices[:, 0, 0].tolist() == [0, 2]
    assert supervision.held.rows.tolist() == [0]
    assert supervision.held.vertices[:, 0, 0].tolist() == [3]
    assert settle_poses(replace(config, settled=0), outfit, silk, database, tmp_path) is None
    nowhere = SettledOutfit(torch.tensor([3]), torch.zeros(1, 5, 3), 4)
    monkeypatch.setattr("train.pbns.supervision.settled_outfit", lambda *given: nowhere)
    with pytest.raises(InputError, match=r"settled\.npz: the cloth flew apart in every pose"):
        settle_poses(config, outfit, silk, database, tmp_path)
