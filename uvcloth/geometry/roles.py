"""Roles of joints: which is the left thigh, in the names of any capture system, character or engine."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path

from uvcloth.errors import InputError
from uvcloth.files.json_file import read_json

MIDDLE_NAMES = {
    "hips": ("hips", "hip", "pelvis"),
    "lower_spine": ("lowerback", "abdomen", "waist", "spine"),
    "middle_spine": ("spine", "chest", "spine1"),
    "upper_spine": ("spine1", "chest2", "spine2", "upperchest"),
    "lower_neck": ("lowerneck", "necklower", "neck", "neck01", "necktwist01"),
    "upper_neck": ("neck1", "neckupper", "neck02", "necktwist02", "neck2", "neck"),
    "head": ("head",),
}
SIDE_NAMES = {
    "thigh": ("upleg", "upperleg", "hip", "thigh", "thighbend", "upperleg01"),
    "shin": ("leg", "knee", "shin", "lowleg", "loleg", "lowerleg", "calf", "lowerleg01"),
    "foot": ("ankle", "foot"),
    "toes": ("toebase", "toe", "toes", "toe0", "ball", "toe31", "toe11", "foot"),
    "upper_arm": ("arm", "upperarm", "uparm", "shldr", "shldrbend", "shoulder", "upperarm01"),
    "clavicle": ("collar", "clavicle", "shoulder"),
    "forearm": ("forearm", "elbow", "lowarm", "loarm", "lowerarm", "forearmbend", "lowerarm01"),
    "hand": ("wrist", "hand"),
    "fingers": (
        *("handindex1", "handmiddle1", "handfinger1", "fingers", "mid1", "middle1", "middleproximal"),
        *("middle01", "fmiddle01", "index1", "indexproximal", "index01", "findex01", "finger1", "finger31"),
    ),
}
"""Canonical role -> names of its joint, without side, separators and prefix, in lower case. The first name
that the skeleton has, and that no role above claimed, is taken; a side in full goes before its letter."""

ROLES = (*MIDDLE_NAMES, *(f"{side}_{part}" for side in ("left", "right") for part in SIDE_NAMES))
"""Every role that a joint can play."""

NUMBERED_SPINES = tuple(
    dict(zip(names, MIDDLE_NAMES, strict=True))
    for names in (
        ("spine", *(f"spine00{number}" for number in range(1, 7))),
        ("root", "spine05", "spine03", "spine01", "neck01", "neck02", "head"),
    )
)
"""Middle joints of Blender's Rigify, numbered from the hips to the head, and of MakeHuman's own rig,
whose spine is numbered from the neck down."""

SPINE_NAME = re.compile(
    r"(lowerback|(abdomen|waist|torso|spine|chest|upperchest)\d*(lower|upper)?\d*|[lt]\d+)"
)
"""Names of the joints between hips and neck, of which files have any number."""

WORD = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+")
SIDES = {"left": "left", "right": "right", "l": "left", "r": "right"}
KNOWN_PREFIXES = ("mixamorig", "def", "org", "j", "bip", "c")
PREFIX_SHARE = 0.6
"""Share of the names that have to begin with a word for it to count as a prefix."""

FAMILIES = {
    "SMPL": r"left_collar",
    "Mixamo": r"mixamorig.*",
    "Character Creator": r"cc_base_.*",
    "3ds Max Biped": r"bip\d+.*",
    "VRoid": r"j_bip_.*",
    "MakeHuman": r"upperleg01l",
    "Blender Rigify": r"(def-)?spine\.?00\d",
    "Bandai-Namco": r"lowerleg_l",
    "Xsens MVN": r"chest4|t12",
    "Rokoko": r"leftthigh",
    "Unreal": r"thigh_l",
    "DAZ": r"lshldr(bend)?",
    "CMU": r"lhipjoint",
    "VRM": r"leftupperleg",
    "3ds Max": r"leftknee",
    "MotionBuilder": r"leftupleg",
}
"""Naming families by a name that only they have, most specific first; LAFAN1 has MotionBuilder's names."""


def joint_roles(names: Iterable[str]) -> dict[str, int]:
    """Index of the joint that plays each role, for joints with a known name.

    Case, separators, prefixes ("mixamorig:", "CC_Base_") and the way of saying left and right do not matter.
    """
    words = _plain_words(names)
    whole = {"".join(parts): joint for joint, parts in enumerate(words)}
    roles = _middle_roles(whole)
    full, short = _side_names(words)
    for side in ("left", "right"):
        for part, aliases in SIDE_NAMES.items():
            candidates = (known.get((side, alias)) for known in (full, short) for alias in aliases)
            joint = next((j for j in candidates if j is not None and j not in roles.values()), None)
            if joint is not None:
                roles[f"{side}_{part}"] = joint
    return {role: roles[role] for role in ROLES if role in roles}


def naming_family(names: Iterable[str]) -> str:
    """Naming family of the joints, or "unknown"."""
    names = list(names)
    spelled = {name.lower() for name in names} | {"".join(parts) for parts in _plain_words(names)}
    return next(
        (
            family
            for family, pattern in FAMILIES.items()
            if any(re.fullmatch(pattern, name) for name in spelled)
        ),
        "unknown",
    )


def read_role_map(path: Path) -> dict[str, str]:
    """Read a JSON object of roles and joint names, {"hips": "Pelvis_02", ...}.

    Raises InputError naming the file if it is not valid, and a role that does not exist.
    """
    expected = 'roles and joint names, as in {"hips": "Pelvis", ...}'
    content = read_json(path, expected)
    if not all(isinstance(name, str) for name in content.values()):
        raise InputError(f"{path}: expected {expected}")
    for role in content:
        if role not in ROLES:
            raise InputError(f"{path}: {role!r:.40} is not a role; there are {', '.join(ROLES)}")
    return content


def table_roles(bones: Sequence[str]) -> dict[str, int]:
    """Joint of each role, given the human bone that a VRM file says each joint is, "" for the others."""
    return {role: joint for role, joint in joint_roles(bones).items() if bones[joint]}


def assign_roles(
    names: Sequence[str], overrides: Mapping[str, str], table: Mapping[str, int] | None = None
) -> dict[str, int]:
    """Assign roles to joints: `overrides` (role -> joint name) first, then the file's own table.

    Without a table the names of the joints decide. Raises InputError naming a joint that the skeleton lacks.
    """
    for name in overrides.values():
        if name not in names:
            near = get_close_matches(name, names, n=3, cutoff=0.4) or names[:6]
            raise InputError(f"--joints: no joint is named {name}; there are {', '.join(near)}, ...")
    given = {role: names.index(name) for role, name in overrides.items()}
    usual = table or joint_roles(names)
    kept = {role: joint for role, joint in usual.items() if joint not in given.values()} | given
    return {role: kept[role] for role in ROLES if role in kept}


def _plain_words(names: Iterable[str]) -> list[list[str]]:
    """Words of each name in lower case, without the prefixes that most names share."""
    words = [[w.lower() for w in WORD.findall(re.split(r"[:|]", name)[-1])] for name in names]
    words = [parts or [""] for parts in words]
    while True:
        first = Counter(parts[0] for parts in words if len(parts) > 1)
        shared = {
            word
            for word, count in first.items()
            if word not in SIDES and (word in KNOWN_PREFIXES or count >= PREFIX_SHARE * len(words))
        }
        if not shared:
            return words
        words = [parts[1:] if len(parts) > 1 and parts[0] in shared else parts for parts in words]


def _middle_roles(whole: Mapping[str, int]) -> dict[str, int]:
    for spine_names in NUMBERED_SPINES:
        if all(name in whole for name in spine_names) and not {"hips", "pelvis"} & whole.keys():
            return {role: whole[name] for name, role in spine_names.items()}
    roles: dict[str, int] = {}
    for role, aliases in MIDDLE_NAMES.items():
        joint = next((whole[a] for a in aliases if a in whole and whole[a] not in roles.values()), None)
        if joint is not None:
            roles[role] = joint
    spine = sorted(joint for name, joint in whole.items() if SPINE_NAME.fullmatch(name))
    if len(spine) >= 3:
        lower, middle, upper = spine[0], spine[len(spine) // 2], spine[-1]
        roles |= {"lower_spine": lower, "middle_spine": middle, "upper_spine": upper}
    return roles


def _side_names(words: Sequence[Sequence[str]]) -> tuple[dict, dict]:
    """Joints by side and remaining name: those with the side in full, and those with its letter."""
    full: dict[tuple[str, str], int] = {}
    short: dict[tuple[str, str], int] = {}
    for joint, parts in enumerate(words):
        name = "".join(parts)
        spoken = next((word for word in parts if word in SIDES), None)
        if spoken is not None:
            rest = list(parts)
            rest.remove(spoken)
            (full if len(spoken) > 1 else short)[SIDES[spoken], "".join(rest)] = joint
            continue
        for begin, side in SIDES.items():
            if name.startswith(begin):
                (full if len(begin) > 1 else short)[side, name.removeprefix(begin)] = joint
                break
    return full, short
