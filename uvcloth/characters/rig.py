"""A character on the skeleton of our bodies: its joints by role, its blend weights, its rest pose.

Every body has the joints of the default body. A joint of the character with a role gives the position of
ours. Without one, ours is placed between its neighbours as in the default body. Limb by limb, the rest pose
is turned to that of the default body, which garments and methods expect.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from uvcloth.bodies.body import Body, likeliest_unit
from uvcloth.characters.reader import Character, Part
from uvcloth.errors import InputError
from uvcloth.geometry.rotations import smallest_rotation
from uvcloth.geometry.skeleton import Skeleton, joint_transforms
from uvcloth.geometry.skinning import skin
from uvcloth.geometry.units import UNITS
from uvcloth.motion.anatomy import unit
from uvcloth.motion.guess import find_roles
from uvcloth.motion.rest import standing_axis
from uvcloth.motion.retarget import LIMB_BONES, REQUIRED_ROLES, body_axes, bone_directions

TRUNK = ("Hips", "LowerBack", "Spine", "Spine1", "Neck", "Neck1", "Head")
"""Our joints from the hips up; missing ones are placed between the others."""

HEADS = ("head", "upper_neck", "lower_neck")
"""Roles of which a character needs at least one as its head."""

HEIGHTS = (0.5, 3.0)
"""Least and greatest height of a character, metres."""

SIZES = {**UNITS, "hundreds of metres": 100.0}
"""Metres in the units that a file may be in; glTF's is the metre."""

LEAST_BONE = 0.01
"""Metres below which a limb has no direction."""


@dataclass(frozen=True)
class RiggedCharacter:
    """A character on our skeleton at our rest pose, metres, Z up, facing -Y.

    parts: with weights (V, J) of the skeleton's joints. roles: joint of the file by role. guessed: True where
    the names of the joints do not tell all roles, and their places decided. unit: the file's. turned: largest
    angle, degrees, by which a limb was turned to our rest pose.

    axes: (3, 3) turn and scale from the file's scene to ours. rested: (J, 3, 4) from the bind pose to our
    rest pose, of our joints. movers: J joints of the character that move ours.
    """

    name: str
    skeleton: Skeleton
    parts: tuple[Part, ...]
    roles: dict[str, str]
    guessed: bool
    unit: str
    turned: float
    axes: Tensor
    rested: Tensor
    movers: tuple[int, ...]


def rig_character(
    character: Character, overrides: Mapping[str, str], pattern: Body, unit: str | None = None
) -> RiggedCharacter:
    """Put a character on the skeleton of a body.

    overrides: joint names by role, for joints whose names do not tell their role. unit: of the file, a key of
    SIZES, None for the one that makes the likeliest height. Raises InputError naming the roles that no joint
    has, and for a character that does not stand, has no human height or has limbs without length.
    """
    roles, guessed = _needed_roles(character, overrides)
    if standing_axis(character.heads, roles) is None:
        raise InputError("the character does not stand in its bind pose (legs down, hands not crossed)")
    turn = body_axes(character.heads, roles).float()
    points = torch.cat([part.mesh.vertices for part in character.parts]) @ turn.T
    tall = float(points[:, 2].max() - points[:, 2].min())
    unit_name = unit or _likeliest_unit(tall)
    metres = tall * SIZES[unit_name]
    if not HEIGHTS[0] <= metres <= HEIGHTS[1]:
        raise InputError(
            f"the character is {tall:.3g} units tall, {metres:.3g} m in {unit_name}, expected "
            f"{HEIGHTS[0]} to {HEIGHTS[1]} m; give another unit with --unit, or scale it"
        )
    known_at = character.heads @ turn.T * SIZES[unit_name]
    ours = pattern.skeleton.roles
    known = {ours[role]: known_at[joint] for role, joint in roles.items() if role in ours}
    _check_limbs(known_at, roles, character)
    heads = _complete(known, pattern, ours)
    bind = Skeleton(pattern.skeleton.names, pattern.skeleton.parents, heads)
    rotations, turned = _to_rest(bind, pattern, ours)
    place = pattern.skeleton.heads
    legs = [ours["left_thigh"], ours["right_thigh"]]
    transforms = joint_transforms(bind, rotations[None], heads[:1])
    rest = _transform_each(heads, transforms[0])
    shift = place[legs].mean(0) - rest[legs].mean(0)
    transforms = joint_transforms(bind, rotations[None], heads[:1] + shift)
    owner = _owners(character, roles, ours)
    parts = tuple(
        _posed(part, turn * SIZES[unit_name], owner, len(place), transforms) for part in character.parts
    )
    return RiggedCharacter(
        name=character.name,
        skeleton=replace(bind, heads=rest + shift),
        parts=parts,
        roles={role: character.joints[joint] for role, joint in roles.items()},
        guessed=guessed,
        unit=unit_name,
        turned=turned,
        axes=turn * SIZES[unit_name],
        rested=transforms[0],
        movers=_movers(pattern.skeleton, roles, ours),
    )


def _likeliest_unit(tall: float) -> str:
    """Likeliest unit of a file, from the character's height: the metre, if that makes a human height."""
    heights = {name: tall * size for name, size in SIZES.items()}
    if HEIGHTS[0] <= heights["m"] <= HEIGHTS[1]:
        return "m"
    return likeliest_unit({name: max(height, LEAST_BONE) for name, height in heights.items()})


def _needed_roles(character: Character, overrides: Mapping[str, str]) -> tuple[dict[str, int], bool]:
    roles, guessed = find_roles(
        character.joints, character.parents, character.heads, overrides, character.table
    )
    missing = [role for role in REQUIRED_ROLES if role not in roles]
    if not any(role in roles for role in HEADS):
        missing.append("head")
    if missing:
        wanted = ", ".join(role.replace("_", " ") for role in missing)
        raise InputError(
            f"no joint of the character is the {wanted}; name them with --joints "
            f"(its joints are {', '.join(character.joints)})"
        )
    return roles, guessed


def _check_limbs(heads: Tensor, roles: Mapping[str, int], character: Character) -> None:
    for bone, tip in LIMB_BONES.items():
        if tip in roles and float((heads[roles[tip]] - heads[roles[bone]]).norm()) < LEAST_BONE:
            raise InputError(
                f"the {bone.replace('_', ' ')} ({character.joints[roles[bone]]} to "
                f"{character.joints[roles[tip]]}) has no length"
            )


def _complete(known: Mapping[int, Tensor], pattern: Body, ours: Mapping[str, int]) -> Tensor:
    """All of our joints (J, 3) m, given some of them."""
    names, parents, usual = pattern.skeleton.names, pattern.skeleton.parents, pattern.skeleton.heads
    trunk = [names.index(name) for name in TRUNK]
    known = dict(known) | _trunk(known, trunk, usual)
    for side in ("left", "right"):
        arm, forearm, hand = (ours[f"{side}_{part}"] for part in ("upper_arm", "forearm", "hand"))
        shoulder = ours[f"{side}_clavicle"]
        if shoulder not in known:
            size = abs(float(known[arm][0])) / abs(float(usual[arm, 0]))
            known[shoulder] = known[arm] + size * (usual[shoulder] - usual[arm])
        before, after = usual[hand] - usual[forearm], known[hand] - known[forearm]
        turn = smallest_rotation(unit(before), unit(after)) * (after.norm() / before.norm())
        for joint in pattern.skeleton.branch(hand)[1:]:
            known.setdefault(joint, known[hand] + turn @ (usual[joint] - usual[hand]))
        shin, foot, toes = (ours[f"{side}_{part}"] for part in ("shin", "foot", "toes"))
        size = float((known[foot] - known[shin]).norm() / (usual[foot] - usual[shin]).norm())
        known.setdefault(toes, known[foot] + size * (usual[toes] - usual[foot]))
    heads = torch.zeros_like(usual)
    for joint, parent in enumerate(parents):
        heads[joint] = known[joint] if joint in known else heads[parent]
    return heads


def _trunk(known: Mapping[int, Tensor], trunk: list[int], usual: Tensor) -> dict[int, Tensor]:
    """Missing joints of the trunk, placed between the known ones in the usual body's proportions."""
    along = torch.cat([torch.zeros(1), (usual[trunk[1:]] - usual[trunk[:-1]]).norm(dim=1).cumsum(0)])
    given = [place for place, joint in enumerate(trunk) if joint in known]
    heads: dict[int, Tensor] = {}
    for place, joint in enumerate(trunk):
        if joint in known:
            continue
        before = max(each for each in given if each < place)
        after = min((each for each in given if each > place), default=None)
        if after is None:
            # Above the last known joint, the trunk keeps the scale that it has below.
            size = (known[trunk[before]] - known[trunk[0]]).norm() / along[before].clamp(min=1e-6)
            heads[joint] = known[trunk[before]] + size * (usual[joint] - usual[trunk[before]])
        else:
            share = (along[place] - along[before]) / (along[after] - along[before])
            heads[joint] = torch.lerp(known[trunk[before]], known[trunk[after]], share)
    return heads


def _to_rest(bind: Skeleton, pattern: Body, ours: Mapping[str, int]) -> tuple[Tensor, float]:
    """Rotations (J, 3, 3) from the bind pose to the pattern's rest pose, and the largest in degrees."""
    source, target = (bone_directions(heads, ours) for heads in (bind.heads, pattern.skeleton.heads))
    role_of = {joint: role for role, joint in ours.items()}
    turns: list[Tensor] = []
    largest = 0.0
    for joint, parent in enumerate(bind.parents):
        role = role_of.get(joint, "")
        if role in source:
            turns.append(smallest_rotation(source[role], target[role]))
            cosine = float((source[role] @ target[role]).clamp(-1.0, 1.0))
            largest = max(largest, float(torch.tensor(cosine).acos().rad2deg()))
        elif role and not role.endswith("fingers"):
            turns.append(torch.eye(3))
        else:
            turns.append(turns[parent] if parent >= 0 else torch.eye(3))
    return torch.stack(turns), largest


def _owners(character: Character, roles: Mapping[str, int], ours: Mapping[str, int]) -> Tensor:
    """Our joint (J,) that takes the weights of each joint of the character: by its role or its parent's."""
    role_of = {joint: role for role, joint in roles.items() if role in ours}
    owners: list[int] = []
    for joint, parent in enumerate(character.parents):
        above = owners[parent] if parent >= 0 else ours["hips"]
        owners.append(ours[role_of[joint]] if joint in role_of else above)
    return torch.tensor(owners)


def _movers(skeleton: Skeleton, roles: Mapping[str, int], ours: Mapping[str, int]) -> tuple[int, ...]:
    """Joint of the character that moves each of our joints: by its role or its parent's."""
    role_of = {joint: role for role, joint in ours.items()}
    movers: list[int] = []
    for joint, parent in enumerate(skeleton.parents):
        movers.append(roles.get(role_of.get(joint, ""), movers[parent] if parent >= 0 else roles["hips"]))
    return tuple(movers)


def _posed(part: Part, turn: Tensor, owner: Tensor, joints: int, transforms: Tensor) -> Part:
    """A part in our axes and rest pose, its weights on our joints."""
    weights = torch.zeros(len(part.weights), joints).index_add(1, owner, part.weights)
    vertices = skin(part.mesh.vertices @ turn.T, weights, transforms)[0]
    return replace(part, mesh=replace(part.mesh, vertices=vertices), weights=weights)


def _transform_each(points: Tensor, transforms: Tensor) -> Tensor:
    """Points (J, 3), each moved by its own transform (J, 3, 4)."""
    return (transforms[..., :3] @ points[..., None]).squeeze(-1) + transforms[..., 3]
