"""Runs of a cage from fine sequences hold the cloth's offsets from the smoothly skinned garment."""

from pathlib import Path

import pytest
import torch

from train.recurrent.cage_runs import VALIDATION, load_run, run_files
from train.recurrent.fine_runs import FineRuns
from uvcloth.bodies.body import Body
from uvcloth.dataset.bodies import keep_body
from uvcloth.dataset.clip import SimulatedClip, SimulatedGarment
from uvcloth.dataset.clip_file import save_simulated
from uvcloth.errors import InputError
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.skinning import skin
from uvcloth.motion.index import INDEX
from uvcloth.motion.library import load_clip

OFFSET = torch.tensor([0.01, -0.02, 0.03])
"""Metres that all cloth is off the skinned garment, in the world."""

SPLITS = {"run": "train", "again": "validation", "never": "test"}


@pytest.fixture(scope="module")
def sequences(body: Body, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A skirt that lies OFFSET off the skinned one, in a clip of each split."""
    folder = tmp_path_factory.mktemp("sequences")
    keep_body(body, folder)
    skirt, transforms = fit_template("skirt", body), load_clip("run", body).window(0, 4).transforms()
    mesh = skirt.mesh
    cloth = skin(mesh.vertices, skirt.smooth_weights, transforms) + OFFSET
    lines = ["trial,subject,split,action,window_start,window_frames,file"]
    for clip, split in SPLITS.items():
        simulated = SimulatedGarment("skirt", cloth, mesh.faces, mesh.vertices, {"template": "skirt"})
        whole = SimulatedClip((simulated,), transforms, 30.0, 1, {"clip": clip, "body": body.name})
        save_simulated(whole, folder / f"{clip}_skirt.npz")
        lines.append(f"{clip},{clip},{split},run,0,4,run.npz")
    (folder / INDEX).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def test_they_hold_the_offsets_of_training_and_validation_clips(sequences: Path, tmp_path: Path) -> None:
    FineRuns(tmp_path, "skirt", (sequences,), quality="fast").run()
    (trained,), (held_out,) = run_files(tmp_path), run_files(tmp_path / VALIDATION)
    assert (load_run(trained).clip, load_run(held_out).clip) == ("run", "again")
    run = load_run(trained)
    posed = run.posed(run.resting)
    torch.testing.assert_close(posed, OFFSET.expand_as(posed), atol=1e-3, rtol=0)


def test_an_unknown_quality_is_refused(sequences: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--quality best: expected one of"):
        FineRuns(tmp_path, "skirt", (sequences,), quality="best").run()
