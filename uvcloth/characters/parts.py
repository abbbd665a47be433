"""Parts of a character: skin or a substitute for it, visible parts without contact, and parts to leave out.

Cloth lies on skin. Hair, eyes and the like are only visible. A character's own clothes are left out where
there is skin beneath them: all of them if it covers the body, else those that lie over it, as a skirt over
bare legs. The others serve as skin, as in games that leave covered skin out.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

import torch
from torch import Tensor

from rasterize.gather import gather
from rasterize.raycast import cast_rays
from uvcloth.characters.enclosed import JUST_ABOVE
from uvcloth.characters.reader import Part
from uvcloth.errors import InputError
from uvcloth.geometry.mesh import face_normals, join_meshes, unit_face_normals, vertex_normals
from uvcloth.physics.exposure import spread

LOOKS = (
    r"hair|brow|lash|beard|mustache|moustache|eye|iris|cornea|pupil|sclera|tear|teeth|tooth|tongue|gum|mouth|"
    r"glasses|goggles|hat|cap|helmet|horn|ear_?ring|necklace|ribbon|tail|wing|weapon|sword|gun|prop|backpack|bag"
)
"""Words in the name of a mesh or a material that mark a part as visible without contact."""

CLOTHES = (
    r"cloth(es|ing)?|outfit|tops?|bottoms?|shirts?|tshirt|blouse|jacket|coat|hood(ie|y)?|sweater|vest|dress|skirt|pants?|"
    r"trousers|jeans|shorts|\w*suit|tie|scarf|sleeves?|gloves?|socks?|stockings?|shoes?|boots?|sneakers?|heels?|"
    r"footwear|belt|cape|robe|accessor(y|ies)|onepiece|[hf]uku"
)
"""The same for clothes; fuku is Japanese for them."""

WORD = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")

NEEDED = {"torso": ("Hips", "LowerBack", "Spine", "Spine1"), "legs": ("UpLeg", "Leg"), "arms": ("Arm",)}
"""Areas that skin has to cover for clothes to be left out, as endings of the joints that move them."""

FEET = ("Foot", "ToeBase")
"""Joints of the feet, as NEEDED has them: programs take the skin inside shoes away."""

HANGS = 0.25
"""Share of the blend weights that are of spring bones from which on a part is clothes, whatever its names."""

DEEPEST, LEAST_OVER, RAYS = 0.3, 0.5, 1000
"""Metres beneath clothes that skin is looked for, the share of them that has to be over it, and rays."""

LEAST_SHARE = 0.35
"""Least share of skin in an area of skin and clothes that counts as covered by skin."""


@dataclass(frozen=True)
class Sorted:
    """Parts of a character: the surface that cloth collides with, parts that are visible only, and parts left
    out. props: pieces of the surface's meshes that are visible only.
    """

    surface: tuple[Part, ...]
    visible: tuple[Part, ...]
    left_out: tuple[Part, ...]
    props: tuple[Part, ...] = ()

    def lines(self) -> list[str]:
        """Report of the use of each part, a line each."""
        return [
            f"  {label(part)}: {len(part.mesh.faces)} faces, {fate}{_swing(part)}"
            for parts, fate in (
                (self.surface, "cloth lies on it"),
                (self.visible, "visible only"),
                (self.props, "worn over the body, visible only"),
                (self.left_out, "left out"),
            )
            for part in parts
        ]


def sort_parts(
    parts: Sequence[Part], joints: Sequence[str], keep: Iterable[str] = (), drop: Iterable[str] = ()
) -> Sorted:
    """Sort the parts of a character by their names.

    joints: names of the J joints of the parts' weights. keep: meshes, or materials, that cloth collides with;
    drop: those to leave out, in spite of their names. Raises InputError for a name that no part has, and if
    nothing is left for cloth to lie on.
    """
    kept, dropped = _named(parts, keep, "--keep"), _named(parts, drop, "--drop")
    fate = {
        place: "left out" if place in dropped else "surface" if place in kept else _kind(part)
        for place, part in enumerate(parts)
    }
    skin = [part for place, part in enumerate(parts) if fate[place] == "surface"]
    clothes = [part for place, part in enumerate(parts) if fate[place] == "clothes"]
    worn_over_skin = bool(skin) and _covers(skin, [*skin, *clothes], joints, NEEDED.values())
    barefoot = bool(skin) and _covers(skin, [*skin, *clothes], joints, [FEET])
    feet = _moving(joints, FEET)
    for place, kind in fate.items():
        if kind == "clothes":
            below = (worn_over_skin or _is_over(parts[place], skin)) and (
                barefoot or _area([parts[place]], feet) < _area([parts[place]], ~feet)
            )
            fate[place] = "left out" if below else "surface"
    by_kind = {
        kind: tuple(part for place, part in enumerate(parts) if fate[place] == kind)
        for kind in ("surface", "visible", "left out")
    }
    if not by_kind["surface"]:
        raise InputError(
            f"cloth has no mesh of the character to collide with; name one with --keep: {_names(parts)}"
        )
    return Sorted(by_kind["surface"], by_kind["visible"], by_kind["left out"])


def label(part: Part) -> str:
    """Name of a part: its mesh's, and its material's where that differs."""
    return part.name if part.material in ("", part.name) else f"{part.name} ({part.material})"


def _swing(part: Part) -> str:
    return "; it hangs from spring bones, --clothes makes it a garment" if part.spring_share > HANGS else ""


def is_clothing(part: Part) -> bool:
    """Test for a part that is clothes by the words in its names, or hangs as clothes do."""
    return _kind(part) == "clothes"


def _named(parts: Sequence[Part], names: Iterable[str], option: str) -> set[int]:
    places: set[int] = set()
    for name in names:
        meant = {place for place, part in enumerate(parts) if name in (part.name, part.material)}
        if not meant:
            near = get_close_matches(name, [part.name for part in parts], n=3, cutoff=0.4)
            hint = f"did you mean {near[0]}?" if near else f"there are {_names(parts)}"
            raise InputError(f"{option} {name}: the character has no mesh or material of this name; {hint}")
        places |= meant
    return places


def _names(parts: Sequence[Part]) -> str:
    return ", ".join(dict.fromkeys(label(part) for part in parts))


def _kind(part: Part) -> str:
    """Kind of a part by the words in its names: first the material's, which says more, then the mesh's.

    What is not visible only and hangs from spring bones is clothes.
    """
    kind = _named_kind(part)
    return "clothes" if kind == "surface" and part.spring_share > HANGS else kind


def _named_kind(part: Part) -> str:
    """Kind of a part by its names alone."""
    for name in (part.material, part.name):
        words = [word.lower() for word in WORD.findall(name)]
        if any(re.fullmatch(f"(?:{LOOKS})s?", word) or re.match("hair|eye", word) for word in words):
            return "visible"
        if "skin" in words or "body" in words:
            return "clothes" if any(re.fullmatch("cloth|clothes", word) for word in words) else "surface"
        if any(re.fullmatch(CLOTHES, word) for word in words):
            return "clothes"
    return "surface"


def _is_over(part: Part, skin: Sequence[Part]) -> bool:
    """True if skin is beneath a part, nearly wherever one looks."""
    if not skin:
        return False
    body = join_meshes((each.mesh.vertices, each.mesh.faces) for each in skin)
    sample = spread(part.mesh.vertices, part.mesh.faces, RAYS)
    normals = gather(vertex_normals(part.mesh.vertices, part.mesh.faces), sample.corners, sample.barycentrics)
    points = sample.points(part.mesh.vertices) + JUST_ABOVE * normals
    hits = cast_rays(points, -normals, body.vertices, body.faces, max_distance=DEEPEST, both_ways=False)
    facing = unit_face_normals(body.vertices, body.faces)[hits.face.clamp(min=0)]
    over = (hits.face >= 0) & ((facing * normals).sum(1) > 0)
    return float(over.float().mean()) >= LEAST_OVER


def _covers(
    skin: Sequence[Part], everything: Sequence[Part], joints: Sequence[str], areas: Iterable[Sequence[str]]
) -> bool:
    """True if skin alone covers some areas, each given by the endings of the joints that move it."""
    for endings in areas:
        moving = _moving(joints, endings)
        if _area(skin, moving) < LEAST_SHARE * _area(everything, moving):
            return False
    return True


def _moving(joints: Sequence[str], endings: Sequence[str]) -> Tensor:
    """Mask (J,) of the joints of some endings, of either side or none."""
    return torch.tensor([any(_ends(joint, ending) for ending in endings) for joint in joints])


def _ends(joint: str, ending: str) -> bool:
    return joint in (ending, f"Left{ending}", f"Right{ending}")


def _area(parts: Iterable[Part], moving: Tensor) -> float:
    """Area, m2, of the faces that the joints of a mask (J,) move most."""
    total = 0.0
    for part in parts:
        strongest = part.weights[part.mesh.faces].sum(1).argmax(1)
        areas = face_normals(part.mesh.vertices, part.mesh.faces).norm(dim=1) / 2
        total += float(areas[moving[strongest]].sum())
    return total
