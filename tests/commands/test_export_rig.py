"""`uvcloth export` from a saved model to files, and how it fails."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.writers.glb_reader import GlbReader
from uvcloth.bodies.body import Body, save_body
from uvcloth.checkpoint import TrainingData, save_checkpoint
from uvcloth.commands.export import Export
from uvcloth.commands.options import FitOptions
from uvcloth.commands.rollout import Rollout
from uvcloth.commands.run.export import RIG_WRITERS, export
from uvcloth.commands.run.rollout import animate
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.methods.pbns.method import PBNS, new_network, pbns_checkpoint, rest_outfit
from uvcloth.methods.pbns.network import PBNSConfig
from uvcloth.methods.rig import pose_vectors
from uvcloth.motion.library import load_clip


@pytest.fixture(scope="module")
def run(body: Body, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a model of the shirt whose blend shapes are noise."""
    outfit = Outfit(body, (fit_template("tops", body),))
    worn, config = rest_outfit(outfit), PBNSConfig(width=8, layers=2)
    poses = pose_vectors(worn.parents, load_clip("jump", body).transforms())
    torch.manual_seed(0)
    network = new_network(config, worn, outfit.garments[0].weights, poses)
    *_, last = network.linears()
    torch.nn.init.constant_(last.bias, 1.0)  # A shape that no pose has would not be saved.
    folder = tmp_path_factory.mktemp("runs") / "shirt"
    save_checkpoint(pbns_checkpoint(PBNS(config, network, worn), body, TrainingData(), {}), folder)
    return folder


def opened(path: Path) -> tuple[set[str], int, int]:
    """Names of a file's meshes, the blend shapes of the shirt and the frames of the motion."""
    if path.suffix == ".glb":
        glb = GlbReader.load(path)
        meshes = {node.name for node in glb.gltf.nodes if node.mesh is not None}
        frames = len(glb.times()) if glb.gltf.animations else 0
        return meshes, len(glb.mesh("tops").primitives[0].targets), frames
    pxr = pytest.importorskip("pxr")
    from pxr import UsdGeom, UsdSkel

    stage = pxr.Usd.Stage.Open(str(path))
    meshes = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    names = {prim.GetName() if prim.GetName() != "mesh" else prim.GetParent().GetName() for prim in meshes}
    shirt = next(prim for prim in meshes if "tops" in str(prim.GetPath()))
    shapes = UsdSkel.BindingAPI(shirt).GetBlendShapesAttr().Get()
    still = stage.GetEndTimeCode() == stage.GetStartTimeCode()
    return names, len(shapes), 0 if still else int(stage.GetEndTimeCode() - stage.GetStartTimeCode()) + 1


@pytest.mark.parametrize("suffix", RIG_WRITERS)
def test_a_motion_gives_one_file(run: Path, tmp_path: Path, suffix: str) -> None:
    out = tmp_path / "new" / f"spin{suffix}"
    exported = export(Export(str(run), out, motion="spin", shapes=2, with_body=False))
    assert list(out.parent.iterdir()) == [out] == list(exported.written)
    assert opened(out) == ({"tops"}, 2, 133)
    lines = exported.lines()
    assert lines[0] == f"{out}: {out.stat().st_size / 1e6:.1f} MB"
    assert lines[1] == "tops; 31 joints, 2 blend shapes, 133 frames at 30 per second"
    assert lines[2] == "four joints per garment vertex cost nothing"
    assert lines[3].startswith("2 blend shapes cost mean 0.")
    assert "mm over 54 training poses; mean" in lines[3]
    assert lines[3].endswith("mm over spin")


@pytest.mark.parametrize("suffix", [".glb", ".usdc"])
def test_without_a_motion_the_embedding_lies_beside(run: Path, tmp_path: Path, suffix: str) -> None:
    pytest.importorskip("onnx")
    onnxruntime = pytest.importorskip("onnxruntime")
    exported = export(Export(str(run), tmp_path / f"rig{suffix}"))
    assert sorted(tmp_path.iterdir()) == sorted(exported.written)
    assert {path.name for path in exported.written} == {f"rig{suffix}", "rig.onnx"}
    assert exported.lines()[2].startswith("tops, body; 31 joints")
    assert exported.lines()[2].endswith("no motion")
    meshes, shapes, frames = opened(tmp_path / f"rig{suffix}")
    assert (meshes, frames) == ({"tops", "body"}, 0)
    session = onnxruntime.InferenceSession(tmp_path / "rig.onnx")
    (weights,) = session.run(["weights"], {"pose": np.zeros((2, 3 * 31), np.float32)})
    assert weights.shape == (2, shapes)


@pytest.mark.parametrize(
    ("out", "options", "words"),
    [
        ("rig.fbx", {}, r"rig\.fbx: the format \.fbx is not supported, use one of \.glb, \.usdc, \.usd"),
        ("rig", {}, r"the format \(none\) is not supported"),
        ("rig.glb", {"shapes": 0}, "--shapes 0: has to be from 1 to 8, as many as the model has"),
        ("rig.glb", {"shapes": 9}, "--shapes 9: has to be from 1 to 8, as many as the model has"),
        ("rig.glb", {"motion": "nowhere.bvh"}, "nowhere.bvh: no such file"),
        (
            "rig.glb",
            {"motion": "strut"},
            r"strut: expected a \.bvh, \.glb, \.gltf, \.vrm, \.fbx, \.vrma or \.npz",
        ),
        ("taken.glb", {"motion": "jump"}, r"taken\.glb: cannot be written \(is a folder\)"),
        ("taken.usdc/rig.glb", {"motion": "jump"}, r"taken\.usdc: cannot be made a folder"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(
    run: Path, tmp_path: Path, out: str, options: dict, words: str
) -> None:
    (tmp_path / "taken.glb").mkdir()
    (tmp_path / "taken.usdc").write_text("")
    with pytest.raises(InputError, match=words) as caught:
        export(Export(str(run), tmp_path / out, **options))
    assert "\n" not in str(caught.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["taken.glb", "taken.usdc"]


@pytest.mark.parametrize("model", ["physxnet", "lbs_smooth"])
def test_a_model_without_blend_shapes_is_refused(tmp_path: Path, model: str) -> None:
    with pytest.raises(InputError, match=f"model {model}: has no blend weights .*`uvcloth rollout` writes"):
        export(Export(model, tmp_path / "rig.glb"))
    assert not list(tmp_path.iterdir())


def test_a_fabric_that_the_model_does_not_read_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--fabric silk: model pbns knows only the fabric of its training"):
        export(Export("pbns", tmp_path / "rig.glb", fabric="silk"))
    with pytest.raises(InputError, match="--fabric silk: model lbs knows only the fabric"):
        animate(
            Rollout(
                "walk", ("tops",), (tmp_path / "walk.npz",), ("lbs",), fitting=FitOptions(fabric=("silk",))
            )
        )
    assert not list(tmp_path.iterdir())


def test_a_body_of_another_shape_is_refused(run: Path, body: Body, tmp_path: Path) -> None:
    skeleton = replace(body.skeleton, heads=body.skeleton.heads * 1.1)
    save_body(replace(body, name="tall", skeleton=skeleton), tmp_path / "tall.npz")
    with pytest.raises(InputError, match="model shirt was trained on another body than 'tall'"):
        export(Export(str(run), tmp_path / "rig.glb", body=tmp_path / "tall.npz"))
    assert [path.name for path in tmp_path.iterdir()] == ["tall.npz"]


def test_a_clip_of_an_unknown_skeleton_is_refused(run: Path, tmp_path: Path) -> None:
    bvh = tmp_path / "snake.bvh"
    bvh.write_text(
        "HIERARCHY\nROOT Head\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n"
        "End Site\n{\nOFFSET 0 1 0\n}\n}\nMOTION\nFrames: 2\nFrame Time: 0.033\n0 0 0\n0 0 1\n"
    )
    with pytest.raises(InputError, match=r"snake\.bvh: "):
        export(Export(str(run), tmp_path / "rig.glb", motion=str(bvh)))
    assert [path.name for path in tmp_path.iterdir()] == ["snake.bvh"]


@pytest.mark.parametrize("interruption", [KeyboardInterrupt(), OSError(28, "No space left on device")])
def test_what_fails_in_the_second_file_leaves_both_as_they_were(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, interruption: BaseException
) -> None:
    def failing(*_: object) -> None:
        raise interruption

    monkeypatch.setattr("uvcloth.commands.run.export.write_embedding", failing)
    (tmp_path / "rig.glb").write_text("old")
    with pytest.raises((KeyboardInterrupt, InputError)):
        export(Export(str(run), tmp_path / "rig.glb"))
    assert [path.name for path in tmp_path.iterdir()] == ["rig.glb"]
    assert (tmp_path / "rig.glb").read_text() == "old"


def test_without_onnx_the_sentence_names_the_extra(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(InputError, match=r"rig\.onnx: .*uvcloth\[export\]"):
        export(Export(str(run), tmp_path / "rig.glb"))
    assert not list(tmp_path.iterdir())
