import json
from pathlib import Path

import pytest

from tests.motion.families import FAMILIES
from uvcloth.errors import InputError
from uvcloth.geometry.roles import assign_roles, joint_roles, naming_family, read_role_map


@pytest.mark.parametrize("family", FAMILIES)
def test_joints_of_every_family_play_their_roles(family: str) -> None:
    expected = FAMILIES[family].names()
    names = [*FAMILIES[family].above, *expected.values()]
    found = {role: names[joint] for role, joint in joint_roles(names).items()}
    # Of two joints between hips and neck each file has its own idea which is the middle one.
    spines = {"lower_spine", "middle_spine", "upper_spine"}
    assert {r: n for r, n in found.items() if r not in spines} == {
        r: n for r, n in expected.items() if r not in spines
    }
    assert {found[r] for r in spines & set(found)} == {expected[r] for r in spines & set(expected)}


def test_twist_and_helper_joints_play_none() -> None:
    names = [
        "thigh_l",
        "thigh_twist_01_l",
        "calf_l",
        "ik_foot_l",
        "foot_l",
        "upperarm_twist_01_l",
        "lowerarm_l",
    ]
    assert joint_roles(names) == {"left_thigh": 0, "left_shin": 2, "left_foot": 4, "left_forearm": 6}


@pytest.mark.parametrize(
    ("family", "named"),
    [
        ("Mixamo", "Mixamo"),
        ("Mixamo, other prefix", "MotionBuilder"),
        ("3ds Max Biped", "3ds Max Biped"),
        ("DAZ", "DAZ"),
        ("Character Creator", "Character Creator"),
        ("Rokoko", "Rokoko"),
        ("Xsens MVN", "Xsens MVN"),
        ("Bandai-Namco", "Bandai-Namco"),
        ("Blender Rigify", "Blender Rigify"),
        ("VRM", "VRM"),
        ("MakeHuman", "MakeHuman"),
    ],
)
def test_families_are_told_by_name(family: str, named: str) -> None:
    layout = FAMILIES[family]
    assert naming_family([*layout.above, *layout.names().values()]) == named
    assert naming_family(["a", "b"]) == "unknown"


def test_a_role_map_goes_before_names(tmp_path: Path) -> None:
    path = tmp_path / "map.json"
    path.write_text(json.dumps({"hips": "root", "left_thigh": "a"}))
    names = ["root", "Hips", "a", "LeftUpLeg", "LeftLeg"]
    assert assign_roles(names, read_role_map(path)) == {"hips": 0, "left_thigh": 2, "left_shin": 4}


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("{", "not readable as JSON"),
        ("[]", "expected roles and joint names"),
        ('{"hips": 3}', "expected roles and joint names"),
        ('{"left_knee": "a"}', "'left_knee' is not a role; there are hips,"),
    ],
)
def test_role_maps_that_are_none_are_refused(tmp_path: Path, content: str, sentence: str) -> None:
    path = tmp_path / "map.json"
    path.write_text(content)
    with pytest.raises(InputError, match=rf"map\.json: .*{sentence}"):
        read_role_map(path)
    with pytest.raises(InputError, match=r"no joint is named Hop; there are Hip"):
        assign_roles(["Hip", "Leg"], {"hips": "Hop"})
