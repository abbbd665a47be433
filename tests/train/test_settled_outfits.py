"""Random outfits and templates that are settled on cages are read as sequences of `uvcloth simulate` are."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import torch

from tests.train.simulated import database_of
from train.settled_outfits import SettledOutfits
from uvcloth.bodies.body import Body, save_body
from uvcloth.dataset.reader import read_outfit_clips
from uvcloth.dataset.splits import training_data
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.rotations import from_axis_angles
from uvcloth.geometry.skinning import skin
from uvcloth.motion.poses import PoseDatabase, save_poses
from uvcloth.physics.fabric import FABRICS
from uvcloth.writers.obj import save_obj

HIPS, RIGHT_ARM = 0, 20
"""Joints of the body."""


def save_wardrobe(folder: Path, body: Body) -> Path:
    """Write two skirts of silk, one of each of the splits `train` and `test`; returns their folder."""
    (folder / "bodies").mkdir(parents=True)
    save_body(replace(body, name="ann"), folder / "bodies" / "ann.npz")
    mesh = fit_template("skirt", body).mesh
    for name, split in (("o0001", "train"), ("o0009", "test")):
        save_obj(mesh, folder / f"{name}_skirt.obj")
        cut = {
            "drop": 0.02,
            "length": 1.0,
            "ease": 0.01,
            "flare": 0.2,
            "slit": 0.0,
            "slit_height": 0.5,
            "slit_side": 0.0,
        }
        values = {
            "version": "uvcloth-outfit-1", "name": name, "split": split, "body": "bodies/ann.npz", "seed": 0,
            "vertex_range": [1000, 2500], "even": True, "seams": False, "tightness": 0.5,
            "fabric": {"name": "silk", "parameters": asdict(FABRICS["silk"])},
            "pieces": [{"file": f"{name}_skirt.obj", "type": "skirt", "vertices": len(mesh.vertices),
                        "parameters": {"skirt": cut}}],
        }  # fmt: skip
        (folder / f"{name}.json").write_text(json.dumps(values), encoding="utf-8")
    return folder


def poses_of(body: Body) -> PoseDatabase:
    """Three poses for training, in the first of which an arm is in the trunk, and one for validation."""
    database = database_of(body, frames=4, held=1)
    rotations = torch.eye(3).repeat(4, len(database.joints), 1, 1)
    rotations[0, RIGHT_ARM : RIGHT_ARM + 6] = from_axis_angles(torch.tensor([0.0, -1.8, 0.0]))
    rotations[1:, HIPS + 2 : HIPS + 6] = from_axis_angles(
        torch.tensor([[-0.5, 0, 0], [0.5, 0, 0], [0.2, 0, 0]])
    )[:, None]
    return replace(database, rotations=rotations)


def test_outfits_and_templates_are_settled_in_training_poses(tmp_path: Path, body: Body) -> None:
    database = poses_of(body)
    save_poses(database, tmp_path / "poses.npz")
    wardrobe, data = save_wardrobe(tmp_path / "wardrobe", body), tmp_path / "data"
    command = SettledOutfits(data, wardrobe, tmp_path / "poses.npz", ("skirt",), each=2, quality="fast")
    command.run()
    dressed = read_outfit_clips(data)
    assert [(clip.outfit, clip.split, clip.warm_up) for _, clip in dressed] == [
        ("o0001", "train", 0),
        ("skirt_ann", "train", 0),
    ]
    assert [outfit.garments[0].fabric for outfit, _ in dressed] == [FABRICS["silk"], FABRICS["jersey"]]
    assert training_data([clip for _, clip in dressed]).clips["train"] == {"swaying": "ann"}
    expected = database.rotations[1:3]
    for outfit, clip in dressed:
        (garment,) = outfit.garments
        near = (clip.transforms[:, None, :, :, :3] - expected).abs().amax((2, 3, 4)) < 1e-4
        assert near.sum(0).tolist() == [1, 1]
        skinned = skin(garment.mesh.vertices, garment.smooth_weights, clip.transforms)
        apart = clip.vertices.float() - skinned
        assert 0.005 < float(apart.norm(dim=2).mean()) < 0.2
        assert float(apart[..., 2].mean()) < 0.0
    times = [path.stat().st_mtime_ns for path in sorted(data.glob("*.npz"))]
    command.run()
    assert [path.stat().st_mtime_ns for path in sorted(data.glob("*.npz"))] == times
