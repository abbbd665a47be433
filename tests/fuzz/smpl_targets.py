"""Readers of model files of SMPL, as npz and pickled."""

import pickle
from pathlib import Path

import numpy as np
from scipy.sparse import csc_matrix

from tests.fuzz.target import Target, require, require_indices, require_numbers
from tests.small_body import small_body
from uvcloth.bodies.smpl import SmplModel, read_smpl
from uvcloth.bodies.smpl_joints import SMPL_JOINTS

JOINTS = len(SMPL_JOINTS["SMPL"])


def arrays() -> dict[str, np.ndarray]:
    """A box in the schema of SMPL: every joint moves it alike."""
    mesh = small_body().mesh
    count = len(mesh.vertices)
    parents = [4294967295, *range(JOINTS - 1)]
    return {
        "v_template": mesh.vertices.double().numpy(),
        "f": mesh.faces.numpy().astype(np.uint32),
        "shapedirs": np.full((count, 3, 10), 0.01),
        "posedirs": np.full((count, 3, 9 * (JOINTS - 1)), 0.001),
        "weights": np.full((count, JOINTS), 1.0 / JOINTS),
        "J_regressor": np.full((JOINTS, count), 1.0 / count),
        "kintree_table": np.array([parents, range(JOINTS)], dtype=np.uint32),
    }


def good_npz(folder: Path) -> Path:
    np.savez(folder / "model.npz", **arrays(), joint2num=np.array({"Pelvis": 0}, dtype=object))
    return folder / "model.npz"


def good_pickle(folder: Path) -> Path:
    content = {**arrays(), "J_regressor": csc_matrix(arrays()["J_regressor"]), "bs_type": "lrotmin"}
    (folder / "model.pkl").write_bytes(pickle.dumps(content, protocol=2))
    return folder / "model.pkl"


def check_model(model: SmplModel) -> None:
    vertices, joints = len(model.template), len(SMPL_JOINTS[model.kind])
    require_numbers(model.template, (vertices, 3), "template")
    require_indices(model.faces, (-1, 3), vertices, "faces")
    require(len(model.faces) > 0, "no faces")
    require_numbers(model.shapes, (-1, vertices, 3), "shapes")
    require_numbers(model.pose_shapes, (9 * (joints - 1), vertices, 3), "pose shapes")
    require_numbers(model.weights, (vertices, joints), "weights")
    require(((model.weights.sum(1) - 1).abs() < 1e-3).all() and (model.weights >= 0).all(), "weights")
    require_numbers(model.regressor, (joints, vertices), "regressor")
    require(model.parents[0] == -1 and len(model.parents) == joints, "parents")
    require(all(0 <= parent < joint for joint, parent in enumerate(model.parents) if joint), "parents")


TARGETS = [
    Target("smpl", good_npz, read_smpl, check_model),
    Target("smpl_pickle", good_pickle, read_smpl, check_model),
]
