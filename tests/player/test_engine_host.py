"""The hosts of docs/engines.md draw, in the axes of their scene, what Python does with their nodes."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.player.system_compiler import compiler
from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Outfit as WornOutfit
from uvcloth.motion.library import load_clip
from uvcloth.player.baked import BakedFile, open_baked
from uvcloth.player.library import library
from uvcloth.player.outfit import Cloth, Outfit
from uvcloth.writers.glb import Document
from uvcloth.writers.gltf_cloth import add_cloth, add_own_body, animate_cloth

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "runtime" / "example"
FRAMES = 12

PROGRAM = """
using System;
using System.IO;

public static class Program {
    public static void Main(string[] names) {
        var bytes = File.ReadAllBytes(names[1]);
        var motion = new double[bytes.Length / 8];
        Buffer.BlockCopy(bytes, 0, motion, 0, bytes.Length);
        using (var cloth = new DressedCharacter(File.ReadAllBytes(names[0])))
        using (var file = new BinaryWriter(File.Create(names[2]))) {
            var joints = new double[12 * cloth.Joints];
            Array.Copy(motion, joints, joints.Length);
            cloth.Start(joints);
            for (int from = 0; from < motion.Length; from += joints.Length) {
                Array.Copy(motion, from, joints, 0, joints.Length);
                cloth.Step(joints, 1.0 / 30.0);
                foreach (double number in cloth.Vertices(0)) file.Write(number);
            }
        }
        try { new DressedCharacter(new byte[9]); }
        catch (ArgumentException error) { Console.WriteLine(error.Message); }
    }
}
"""
"""Plays an outfit with the class of the page, and writes the vertices."""


@pytest.fixture(scope="module")
def hero(tmp_path_factory: pytest.TempPathFactory, body: Body, worn: WornOutfit, content: bytes) -> Path:
    """A baked file in a folder of its own, with what an importer knows of it beside it."""
    path = tmp_path_factory.mktemp("hero") / "hero.glb"
    document, walk = Document(), load_clip("walk", body)
    skin = add_own_body(document, body)
    add_cloth(document, skin, worn.garments, content)
    animate_cloth(document, skin, walk.transforms(torch.float64).numpy()[:FRAMES], walk.fps)
    document.write(path)
    search = os.environ | {"PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, EXAMPLE / "write_rig.py", path], check=True, env=search)
    return path


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The compiled host."""
    command = compiler("CXX", "c++", "g++", "clang++")
    if not command:
        pytest.skip("the system has no C++ compiler")
    program, loaded = tmp_path_factory.mktemp("host") / "host", Path(library()._name)
    flags = ("-std=c++20", "-Wall", "-Wextra", "-Werror", f"-I{ROOT / 'runtime' / 'include'}")
    linked = (EXAMPLE / "host.cpp", loaded, f"-Wl,-rpath,{loaded.parent}", "-o", program)
    subprocess.run([*command, *flags, *linked], check=True)
    return program


def vertices_of(path: Path) -> np.ndarray:
    rows = [line.split()[1:] for line in path.read_text().splitlines() if line.startswith("v ")]
    return np.array(rows, np.float64)


def test_a_host_with_nodes_of_its_own_draws_what_python_does(host: Path, hero: Path, tmp_path: Path) -> None:
    rig = (hero.with_suffix(".cloth"), hero.with_suffix(".rig"))
    subprocess.run([host, *rig, str(FRAMES), tmp_path], check=True)
    baked = open_baked(hero)
    rows = np.fromfile(tmp_path / "nodes.bin").reshape(FRAMES, -1)
    transforms = baked.skin.transforms(rows[:, 1:].reshape(FRAMES, -1, 4, 4))
    assert np.ptp(transforms[:, 0, :, 3], axis=0).max() > 0.2, "the character stays where it is"
    cloth = Cloth(Outfit(baked.content))
    cloth.start(transforms[0])
    for frame, (seconds, joints) in enumerate(zip(rows[:, 0], transforms, strict=True)):
        cloth.step(joints, seconds)
        for index, garment in enumerate(baked.garments):
            drawn = vertices_of(tmp_path / f"{garment.name}_{frame}.obj")
            expected = baked.in_scene(cloth.vertices(index))[garment.vertices]
            np.testing.assert_allclose(drawn, expected, atol=1e-6 * scale(baked))


def scale(baked: BakedFile) -> float:
    """Units of the scene in a metre."""
    return float(1.0 / np.linalg.norm(baked.skin.axes[0, :3]))


def test_a_rig_of_another_file_is_refused(host: Path, hero: Path, tmp_path: Path) -> None:
    words = hero.with_suffix(".rig").read_text().split("\n")
    (tmp_path / "cut.rig").write_text("\n".join(words[:9]))
    (tmp_path / "other.rig").write_text("\n".join([words[0], "0 0", *words[2:]]))
    for name, sentence in (("cut.rig", "is cut, or no rig"), ("other.rig", "is the rig of another file")):
        command = [host, hero.with_suffix(".cloth"), tmp_path / name, "1", tmp_path]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (1, f"{tmp_path / name}: {sentence}\n")


def test_the_class_of_the_page_gives_in_csharp_what_python_does(hero: Path, tmp_path: Path) -> None:
    if not (shutil.which("mcs") and shutil.which("mono")):
        pytest.skip("the system has no Mono")
    page = (ROOT / "docs" / "engines.md").read_text(encoding="utf-8")
    (source,) = re.findall(r"^```csharp\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    (tmp_path / "character.cs").write_text(source, encoding="utf-8")
    (tmp_path / "program.cs").write_text(PROGRAM, encoding="utf-8")
    compiled = ["mcs", "-warnaserror", "-out:program.exe", "character.cs", "program.cs"]
    subprocess.run(compiled, cwd=tmp_path, check=True)
    shutil.copy(library()._name, tmp_path / "libuvcloth.so")
    baked = open_baked(hero)
    motion = baked.motion(fps=30.0).transforms[:FRAMES]
    np.ascontiguousarray(motion, np.float64).tofile(tmp_path / "motion")
    command = ["mono", "program.exe", hero.with_suffix(".cloth"), "motion", "vertices"]
    search = os.environ | {"LD_LIBRARY_PATH": str(tmp_path)}
    done = subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True, env=search)
    assert done.stdout == "the outfit is cut: it has fewer bytes than a header\n"
    drawn = np.fromfile(tmp_path / "vertices").reshape(FRAMES, -1, 3)
    cloth = Cloth(Outfit(baked.content))
    cloth.start(motion[0])
    for joints, vertices in zip(motion, drawn, strict=True):
        cloth.step(joints, 1.0 / 30.0)
        np.testing.assert_array_equal(vertices, cloth.vertices(0))
