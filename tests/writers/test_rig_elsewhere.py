"""The rig's file as other programs play it, against our rollout: Blender, and three.js in a browser."""

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from tests.writers.glb_reader import GlbReader, to_z_up
from uvcloth.garments.garment import Outfit
from uvcloth.methods.rig import PoseRig
from uvcloth.motion.clip import Clip
from uvcloth.writers.gltf_rig import write_rig_glb
from uvcloth.writers.rig import rig_of
from uvcloth.writers.usd_rig import write_rig_usd

HERE = Path(__file__).parent
FRAMES = list(range(0, 40, 4))
MILLIMETRE = 1e-3


@pytest.fixture(scope="module")
def path(pose_rig: PoseRig, outfit: Outfit, clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rig") / "wave.glb"
    write_rig_glb(rig_of(pose_rig, outfit.body, clip).rig, path)
    return path


@pytest.fixture(scope="module")
def expected(path: Path, rolled: list[np.ndarray], outfit: Outfit) -> dict[str, np.ndarray]:
    """Per garment (10, M, 3), the vertices of the file, Z up."""
    glb = GlbReader.load(path)
    names = [garment.name for garment in outfit.garments]
    return {name: rolled[index][FRAMES][:, glb.source(name)] for index, name in enumerate(names)}


@pytest.mark.parametrize("suffix", [".glb", ".usdc"])
def test_blender_plays_the_rollout(
    path: Path,
    expected: dict[str, np.ndarray],
    pose_rig: PoseRig,
    outfit: Outfit,
    clip: Clip,
    tmp_path: Path,
    suffix: str,
) -> None:
    python = os.environ.get("UVCLOTH_BLENDER_PYTHON")
    if not python:
        pytest.skip("needs UVCLOTH_BLENDER_PYTHON, a Python that has the package bpy")
    frames = [str(frame) for frame in FRAMES]
    if suffix == ".usdc":
        path = tmp_path / "wave.usdc"
        write_rig_usd(rig_of(pose_rig, outfit.body, clip).rig, path)
    command = [python, HERE / "play_in_blender.py", path, tmp_path / "played.npz", "30", *expected]
    # Its Python must not find our packages.
    clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    subprocess.run([*command, "--", *frames], check=True, capture_output=True, env=clean, timeout=300)
    with np.load(tmp_path / "played.npz") as played:
        for name, vertices in expected.items():
            own = played[name].shape[1]  # USD needs no repeated vertices on seams.
            apart = np.linalg.norm(played[name] - vertices[:, :own], axis=-1).max()
            print(f"Blender from {suffix}, {name}: at most {1e3 * apart:.4f} mm")
            assert apart < MILLIMETRE


def test_three_js_plays_the_rollout(path: Path, expected: dict[str, np.ndarray], tmp_path: Path) -> None:
    modules, node = Path(os.environ.get("NODE_PATH", "")), shutil.which("node")
    chromium = os.environ.get("UVCLOTH_CHROMIUM") or shutil.which("chromium")
    if (
        not node
        or not chromium
        or not all((modules / name).is_dir() for name in ("three", "playwright-core"))
    ):
        pytest.skip(
            "needs node, chromium (or UVCLOTH_CHROMIUM), and NODE_PATH naming the folder of the npm packages "
            "three and playwright-core"
        )
    seconds = [str(frame / 30) for frame in FRAMES]
    command = [node, HERE / "play_in_three.cjs", path, tmp_path / "played.f32", chromium, *expected]
    subprocess.run([*command, "--", *seconds], check=True, capture_output=True, timeout=300)
    values = np.fromfile(tmp_path / "played.f32", np.float32)
    for name, vertices in expected.items():
        played, values = values[: vertices.size].reshape(vertices.shape), values[vertices.size :]
        apart = np.linalg.norm(to_z_up(played) - vertices, axis=-1).max()
        print(f"three.js, {name}: at most {1e3 * apart:.4f} mm")
        assert apart < MILLIMETRE
    assert not len(values)
