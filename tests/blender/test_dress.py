"""An artist's own mesh in Blender, baked by a child process and live."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.blender.conftest import Done, run_in_blender

ROOT = Path(__file__).parents[2]
SKIRT = ROOT / "uvcloth" / "data" / "garments" / "miniskirt.obj"
NEAR, FAR = 0.02, 0.3
"""Metres from the body within which the skirt's waist is, and beyond which none of it is."""


@pytest.fixture(scope="module")
def dressed(
    blender_python: str, extension: Path, baked: Path, tmp_path_factory: pytest.TempPathFactory
) -> Done:
    """What dress_in_blender.py does."""
    if os.name == "nt":
        pytest.skip("the laboratory of this test is a shell script")
    folder = tmp_path_factory.mktemp("dressed")
    # This checkout's uvcloth, whichever is installed beside the interpreter.
    python = folder / "python"
    python.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" "$@"\n', encoding="utf-8")
    python.chmod(0o755)
    return run_in_blender(blender_python, "dress_in_blender.py", extension, baked, SKIRT, python, folder)


def test_the_mesh_itself_is_live_below_armature_and_above_the_rest(dressed: Done) -> None:
    assert dressed.said["modifiers"] == ["NODES", "SUBSURF"]
    assert dressed.said["file"] == "//uvcloth_baked/scene-Armature.glb"
    assert (dressed.folder / "uvcloth_baked" / "scene-Armature.glb").exists()
    assert dressed.said["fault"] == ""


@pytest.mark.parametrize("frame", ["first", "last"])
def test_the_skirt_is_on_the_body(dressed: Done, frame: str) -> None:
    """In the axes of the body, which is drawn at twice its size."""
    distances = dressed.arrays[frame]
    assert np.quantile(distances, 0.2) < NEAR
    assert distances.max() < FAR


def test_what_cannot_be_dressed_is_refused_in_a_sentence(dressed: Done) -> None:
    expected = (
        "select the garment meshes too",
        "name a Python that has uvcloth",
        "cannot be run",
        "has no uvcloth",
        "has no visible skin",
        "negative scale",
    )
    for sentence, words in zip(dressed.said["refused"], expected, strict=True):
        assert words in sentence
        assert "\n" not in sentence
    assert dressed.said["untouched"] == [["SUBSURF"], ""]
