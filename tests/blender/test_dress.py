"""An artist's own meshes in Blender: checked, fitted, baked by a child process, and live."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.blender.conftest import Done, run_in_blender
from uvcloth.bodies.body import Body
from uvcloth.garments.templates import fit_template
from uvcloth.player.baked import open_baked
from uvcloth.writers.obj import save_obj

ROOT = Path(__file__).parents[2]
SKIRT = ROOT / "uvcloth" / "data" / "garments" / "miniskirt.obj"
NEAR, FAR, CLOTH = 0.02, 0.3, 0.003
"""Metres from the body within which a fifth of a garment is, beyond which none is, and of cloth beneath."""


@pytest.fixture(scope="module")
def dressed(
    blender_python: str, extension: Path, baked: Path, body: Body, tmp_path_factory: pytest.TempPathFactory
) -> Done:
    """What dress_in_blender.py does."""
    if os.name == "nt":
        pytest.skip("the laboratory of this test is a shell script")
    folder = tmp_path_factory.mktemp("dressed")
    # This checkout's uvcloth, whichever is installed beside the interpreter.
    python = folder / "python"
    python.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" "$@"\n', encoding="utf-8")
    python.chmod(0o755)
    tops = folder / "tops.obj"
    save_obj(fit_template("tops", body).mesh, tops)
    return run_in_blender(
        blender_python, "dress_in_blender.py", extension, baked, SKIRT, tops, python, folder
    )


def test_the_mesh_itself_is_live_below_armature_and_above_the_rest(dressed: Done) -> None:
    """Though it is hidden, in a hidden collection, and was so before the armature moved on."""
    assert dressed.said["dressed"] == ["RUNNING_MODAL", "FINISHED", [], ["timer", None]]
    assert dressed.said["modifiers"] == ["NODES", "SUBSURF"]
    assert dressed.said["file"] == "//uvcloth_baked/scene-Armature.glb"
    assert (dressed.folder / "uvcloth_baked" / "scene-Armature.glb").exists()
    assert dressed.said["fault"] == ""


def test_garments_are_worn_in_the_order_of_the_list_and_of_tucks(dressed: Done) -> None:
    assert dressed.said["order"] == ["tops", "skirt"]
    assert dressed.said["rows"] == [["skirt", 1], ["tops", 0]]


@pytest.mark.parametrize("garment", ["skirt", "tops"])
@pytest.mark.parametrize("frame", ["first", "last"])
def test_the_garments_are_on_the_body(dressed: Done, garment: str, frame: str) -> None:
    """In the axes of the body, which is drawn at a hundred times its size."""
    distances = dressed.arrays[f"{garment}_{frame}"]
    assert np.quantile(distances, 0.2) < NEAR + (CLOTH if garment == "skirt" else 0.0)
    assert distances.max() < FAR


def test_garments_of_one_name_have_files_of_their_own(dressed: Done) -> None:
    assert dressed.said["names"] == ["a_2", "a", "a_3", "A_3_3", "garment"]


def test_a_bone_pins_the_cloth_on_its_skin(dressed: Done) -> None:
    sleeve, trunk = (dressed.arrays[f"near_{bone}"][:, 0] for bone in ("LeftArm", "Spine"))
    assert min(len(sleeve), len(trunk)) > 100
    assert sleeve.min() > 0.1
    assert np.abs(trunk).max() < 0.25


def test_a_file_for_engines_has_the_motion_of_the_scene(dressed: Done) -> None:
    begun, ended, (report,), _ = dressed.said["to_file"]
    assert (begun, ended) == ("RUNNING_MODAL", "FINISHED")
    path = dressed.folder / "scene-Armature.glb"
    assert str(path) in report
    before, after = dressed.said["to_file_left"]
    assert before == after
    baked = open_baked(path)
    assert [garment.name for garment in baked.garments] == ["tops"]
    motion = baked.motion()
    assert motion.times[-1] - motion.times[0] == pytest.approx(9 / 30, abs=1e-3)
    assert np.ptp(motion.transforms, axis=0).max() > 0.01


def test_a_fit_is_shown_taken_back_or_accepted(dressed: Done) -> None:
    begun, ended, (report,), _ = dressed.said["fitted"]
    assert (begun, ended) == ("RUNNING_MODAL", "FINISHED")
    assert report.startswith("INFO: skirt would be moved by up to ")
    assert dressed.said["previews"] == ["skirt fit"]
    assert dressed.said["wire"] == "WIRE"
    before, after, is_same = dressed.said["taken_back"]
    assert before == after
    assert is_same
    assert dressed.said["accepted"] == [True, True]


def test_vertices_that_start_in_the_body_are_marked_and_selected(dressed: Done) -> None:
    marked, selected = dressed.said["marked"]
    assert marked > 50
    assert 0 < selected <= marked
    assert dressed.said["clean"]


def test_what_is_stopped_or_killed_leaves_the_scene_as_it_was(dressed: Done) -> None:
    assert dressed.said["stopped"] == ["RUNNING_MODAL", "CANCELLED", [], ["timer", None]]
    begun, ended, (report,), cleared = dressed.said["killed"]
    assert (begun, ended, cleared) == ("RUNNING_MODAL", "CANCELLED", ["timer", None])
    assert report.startswith("ERROR: the laboratory has ended")
    before, after = dressed.said["left"]
    assert before == after


def test_cloth_follows_a_pose_while_the_timeline_stands(dressed: Done) -> None:
    assert not dressed.said["stands"]
    assert dressed.said["steps"] == 60
    assert dressed.arrays["posed"].max() > 0.02
    assert not dressed.arrays["back"].any()


def test_a_garment_that_is_taken_off_leaves_the_others_live(dressed: Done) -> None:
    assert dressed.said["taken_off"] == [["SUBSURF"], "", True]


def test_wrinkles_are_on_a_finer_copy_that_goes_with_the_garment(dressed: Done) -> None:
    assert dressed.said["wrinkled"] == ["RUNNING_MODAL", "FINISHED", [], ["timer", None]]
    own, finer, modifiers, looks, states, skins = dressed.said["finer"]
    assert finer > 3.9 * own
    assert modifiers == ["NODES", "SUBSURF"]
    assert looks == ["red", 1]
    assert states == [True, True, True, ""]
    assert skins == ["body"]
    assert np.quantile(dressed.arrays["finer"], 0.2) < NEAR
    assert dressed.arrays["finer"].max() < FAR
    assert dressed.said["dropped"] == [False, False, True]


def test_the_laboratory_ends_with_the_extension(dressed: Done) -> None:
    assert not dressed.said["child_left"]


def test_what_cannot_be_dressed_is_refused_in_a_sentence(dressed: Done) -> None:
    expected = (
        "select the garment meshes too",
        "name a Python that has uvcloth",
        "cannot be run",
        "has no uvcloth",
        "has uvcloth 9.0, which is not for this version of the extension",
        "is older than this extension",
        "has no visible skin",
        "negative scale",
        "uneven scale",
        "skirt.obj: the garment does not lie on the body",
        "Armature is hidden",
        "skirt, a garment of Armature, is not in this view layer",
        "vertex group pinned is empty",
        "has no bone Nose any more",
    )
    for sentence, words in zip(dressed.said["refused"], expected, strict=True):
        assert words in sentence
        assert "\n" not in sentence
    assert dressed.said["untouched"] == [["SUBSURF"], ""]
