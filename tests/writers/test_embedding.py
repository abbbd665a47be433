"""The ONNX beside a rig: the same weights as ours, and enough to pose the rig as an engine would."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from tests.writers.glb_reader import GlbReader, to_z_up
from tests.writers.played import rolled_out
from uvcloth.garments.garment import Outfit
from uvcloth.methods.pbns.method import PBNS
from uvcloth.methods.rig import PoseRig, pose_vectors
from uvcloth.motion.clip import Clip
from uvcloth.writers.embedding import write_embedding
from uvcloth.writers.gltf_rig import write_rig_glb
from uvcloth.writers.rig import rig_of

pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")


@pytest.mark.parametrize("shapes", [None, 6])
def test_onnx_gives_the_rig_s_weights(
    pose_rig: PoseRig, outfit: Outfit, clip: Clip, tmp_path: Path, shapes: int | None
) -> None:
    rigged = rig_of(pose_rig, outfit.body, shapes=shapes)
    write_embedding(pose_rig, rigged, tmp_path / "rig.onnx")
    session = onnxruntime.InferenceSession(tmp_path / "rig.onnx")
    for poses in (pose_rig.poses, pose_vectors(pose_rig.parents, clip.transforms())):
        (weights,) = session.run(["weights"], {"pose": poses.numpy()})
        with torch.no_grad():
            embeddings = pose_rig.embed(poses)
        free = embeddings @ rigged.code.scale + rigged.code.shift
        np.testing.assert_allclose(weights, free.clamp(0, 1), atol=1e-5)
    assert free.min() < -0.01  # The clip leaves the trained range, where the file's weights stop.


def pose_vector(glb: GlbReader, frame: int | None, names: list[str], parents: list[int]) -> np.ndarray:
    """The input as docs/engines.md builds it: from the rotations of glTF nodes, which are Y up."""
    parts = []
    for name, parent in zip(names, parents, strict=True):
        turn = Rotation.from_matrix(glb.locals(frame)[glb.node(name)][:3, :3])
        vector = turn.as_rotvec() if parent >= 0 else turn.inv().apply([0.0, -1.0, 0.0])
        parts.append(to_z_up(vector))
    return np.concatenate(parts).astype(np.float32)[None]


def test_the_rest_pose_gives_the_file_s_own_weights(
    pose_rig: PoseRig, outfit: Outfit, tmp_path: Path
) -> None:
    rigged = rig_of(pose_rig, outfit.body)
    write_rig_glb(rigged.rig, tmp_path / "rig.glb")
    write_embedding(pose_rig, rigged, tmp_path / "rig.onnx")
    rig = GlbReader.load(tmp_path / "rig.glb")
    session = onnxruntime.InferenceSession(tmp_path / "rig.onnx")
    facts = session.get_modelmeta().custom_metadata_map
    pose = pose_vector(rig, None, json.loads(facts["joints"]), json.loads(facts["parents"]))
    (weights,) = session.run(["weights"], {"pose": pose})
    np.testing.assert_allclose(weights[0], rig.weights("shirt", None), atol=1e-6)


def test_an_engine_can_pose_the_rig_alone(pbns: PBNS, outfit: Outfit, practice: Clip, tmp_path: Path) -> None:
    """Joint rotations from one file drive the ONNX, its weights the other file's targets."""
    write_rig_glb(rig_of(pbns.as_rig(outfit.body), outfit.body, practice).rig, tmp_path / "motion.glb")
    alone = rig_of(pbns.as_rig(outfit.body), outfit.body)
    write_rig_glb(alone.rig, tmp_path / "rig.glb")
    write_embedding(pbns.as_rig(outfit.body), alone, tmp_path / "rig.onnx")
    motion, rig = GlbReader.load(tmp_path / "motion.glb"), GlbReader.load(tmp_path / "rig.glb")
    session = onnxruntime.InferenceSession(tmp_path / "rig.onnx")
    facts = session.get_modelmeta().custom_metadata_map
    names, parents = json.loads(facts["joints"]), json.loads(facts["parents"])
    assert json.loads(facts["shapes"]) == rig.mesh("shirt").extras["targetNames"]
    expected = rolled_out(pbns, outfit, practice)
    for frame in (0, 9, 20, 33):
        (weights,) = session.run(["weights"], {"pose": pose_vector(motion, frame, names, parents)})
        posed = {rig.node(name): motion.locals(frame)[motion.node(name)] for name in names}
        own = {**rig.locals(None), **posed}
        for garment, vertices in zip(outfit.garments, expected, strict=True):
            made = to_z_up(rig.skinned(garment.name, rig.morphed(garment.name, weights[0]), own))
            apart = np.linalg.norm(made - vertices[frame, rig.source(garment.name)], axis=1)
            assert apart.max() < 1e-4
