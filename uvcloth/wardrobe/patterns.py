"""Patterns: the surface around a body that a design cuts out, and the ease of the cloth over it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uvcloth.bodies.body import Body
from uvcloth.garments.cut import cut, place
from uvcloth.garments.openings import (
    forearm_share,
    neck,
    sleeves,
    upper_arm_share,
    waist_height,
    waistband,
)
from uvcloth.garments.remesh import largest
from uvcloth.garments.shells import SkirtCut, cut_bodice, dress_shell, joint, tight_shell
from uvcloth.wardrobe.designs import Design, Legs, Skirt, Upper

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SNUG = 0.0055
"""Metres off the skin where a garment is held: at neck, shoulders and waist."""

WAISTBAND = 0.035
"""Height of a skirt's waistband, m."""

ARMHOLE = 0.06
"""Place along the upper arm, as a share of it, where the armhole of a sleeveless garment is."""

ARM_BEGINS = 0.15
"""Place along the upper arm, as a share of it, where cloth counts as sleeve."""

CUFF_STRETCH = 2.0
"""Factor on lengths at the wrist where a pattern is meshed: how much shorter edges are there."""

FREE_ARM = 0.6
"""Place along the upper arm from where on no hem of the trunk cuts a sleeve."""

BELOW_NECK = 0.02
"""Metres from the base of the neck down to the top of a neckline."""

ABOVE_ANKLE = 0.055
"""Metres over the ankle of the longest legs and skirts."""


@dataclass(frozen=True)
class Pattern:
    """Surface that a piece is cut from: vertices (P, 3) m on the body's rest pose, faces (Q, 3)."""

    vertices: Array
    faces: Indices


def cut_pattern(design: Design, body: Body) -> Pattern:
    """Cut a design on a body at rest.

    Raises InputError if the body lacks a proxy or joint that the design needs, or if a hem does not close.
    """
    vertices, faces = tight_shell(body)
    if design.skirt is None:
        field = np.full(len(vertices), np.inf)
        if design.upper is not None:
            field = _upper(design.upper, body, vertices, hem=design.legs is None)
        if design.legs is not None:
            field = np.minimum(field, _legs(design.legs, body, vertices, waist=design.upper is None))
        edges, along, kept = cut(faces, field)
        return Pattern(*largest(place(vertices, edges, along), kept))
    band = waistband(body, vertices, design.skirt.drop)
    if design.upper is None:
        field = waist_strip(body, vertices, design.skirt.drop)
    else:
        field = np.where(_on_arm(body, vertices), np.inf, -band)
        field = np.minimum(field, _upper(design.upper, body, vertices, hem=False))
    bottom = leg_height(body, design.skirt.length)
    shape = SkirtCut(bottom, design.skirt.ease, design.skirt.flare)
    pattern = Pattern(*dress_shell(body, cut_bodice(body, field), shape))
    return _slit(pattern, design.skirt, body) if design.skirt.slit else pattern


def leg_height(body: Body, length: float) -> float:
    """Height, m, along the legs: 0 at the hips, 1 at the knees, 2 over the ankles."""
    hip, knee, foot = (joint(body, name)[2] for name in ("LeftUpLeg", "LeftLeg", "LeftFoot"))
    return float(np.interp(length, [0.0, 1.0, 2.0], [hip, knee, foot + ABOVE_ANKLE][::1]))


def waist_strip(body: Body, vertices: Array, drop: float) -> Array:
    """Field (P,) m of the waistband of a skirt, `drop` metres below the waist."""
    above, below = (waistband(body, vertices, each) for each in (drop, drop + WAISTBAND))
    return np.minimum(np.minimum(above, -below), _off_arms(body, vertices))


def ease(design: Design, body: Body, vertices: Array) -> Array:
    """Metres (P,) that cloth at points (P, 3) m keeps off the skin: tight at the top, looser downwards."""
    z = vertices[:, 2]
    off = np.full(len(vertices), SNUG)
    hip, waist = joint(body, "LeftUpLeg")[2], waist_height(body)
    arm = upper_arm_share(body, vertices)
    if design.legs is not None:
        legs = design.legs
        end, top = leg_height(body, legs.length), waist - legs.drop - 0.04
        off = np.interp(z, [hip - 0.05, top], [legs.ease, SNUG])
        off = off + legs.flare * np.clip(1 - (z - end) / (0.6 * (hip - end)), 0, 1)
    if design.upper is not None:
        upper = design.upper
        bottom = waist if design.legs or design.skirt else trunk_height(body, upper.hem)
        shoulder, chest = joint(body, "LeftArm")[2], joint(body, "Spine1")[2]
        at_waist = min(upper.ease, design.legs.ease if design.legs else 0.012 if design.skirt else 1.0)
        trunk = np.interp(
            z, [bottom, chest, shoulder], [at_waist, 0.5 * SNUG + 0.5 * max(upper.ease, SNUG), SNUG]
        )
        trunk = trunk + upper.flare * np.clip(1 - (z - bottom) / (0.7 * (chest - bottom)), 0, 1) * (
            design.legs is None and design.skirt is None
        )
        off = np.where(z > bottom, trunk, off)
        end = min(max(upper.sleeve, 0.3), 1.0)
        sleeve = np.interp(arm, [ARM_BEGINS, end], [SNUG + 0.001, upper.sleeve_ease])
        on_arm = (arm > ARM_BEGINS) | (forearm_share(body, vertices) > 0)
        off = np.where(on_arm, sleeve, off)
    return off


def sleeves_stretched(body: Body, vertices: Array) -> Array:
    """Points (P, 3) m with sleeves longer and wider towards the wrist, CUFF_STRETCH times at it.

    Triangles that are even on this surface are finer in sleeves, whose cuffs otherwise have six or seven
    vertices.
    """
    stretched, on_arm = vertices.copy(), _on_arm(body, vertices)
    for side in ("Left", "Right"):
        shoulder, elbow, wrist = (joint(body, f"{side}{name}") for name in ("Arm", "ForeArm", "Hand"))
        start = shoulder + FREE_ARM * (elbow - shoulder)
        length = np.linalg.norm(wrist - start)
        axis = (wrist - start) / length
        sleeve = on_arm & (vertices[:, 0] * shoulder[0] > 0)
        along = ((vertices[sleeve] - start) @ axis).clip(min=0.0)[:, None]
        across = vertices[sleeve] - start - along * axis
        more = (CUFF_STRETCH - 1.0) * along / length
        stretched[sleeve] = start + along * (1.0 + more / 2.0) * axis + (1.0 + more) * across
    return stretched


def trunk_height(body: Body, share: float) -> float:
    """Height, m, between hips, 0, and neck, 1."""
    hip, base = joint(body, "LeftUpLeg")[2], joint(body, "Neck")[2]
    return float(hip + share * (base - hip))


def _upper(upper: Upper, body: Body, vertices: Array, hem: bool) -> Array:
    """Field (P,) m of an upper part; hem: whether it ends at its own."""
    field = np.minimum(neck(body, vertices, drop=0.0), sleeves(body, vertices, max(upper.sleeve, ARMHOLE)))
    field = np.minimum(field, _neckline(upper, body, vertices))
    if hem:
        above = vertices[:, 2] - trunk_height(body, upper.hem)
        field = np.minimum(field, np.where(_on_arm(body, vertices), np.inf, above))
    if upper.front_gap:
        in_front = vertices[:, 1] < joint(body, "Neck")[1]
        field = np.minimum(field, np.where(in_front, np.abs(vertices[:, 0]) - upper.front_gap / 2, np.inf))
    return field


def _neckline(upper: Upper, body: Body, vertices: Array) -> Array:
    """Field (P,) m of what a neckline leaves in front."""
    if not upper.neck_depth:
        return np.full(len(vertices), np.inf)
    base = joint(body, "Neck")
    across = np.abs(vertices[:, 0]) / upper.neck_width
    down = np.abs(vertices[:, 2] - base[2] + BELOW_NECK) / (upper.neck_depth + BELOW_NECK)
    power = upper.neck_power
    beyond = ((across**power + down**power) ** (1 / power) - 1) * upper.neck_width
    return np.where(vertices[:, 1] < base[1], beyond, np.inf)


def _legs(legs: Legs, body: Body, vertices: Array, waist: bool) -> Array:
    """Field (P,) m of legs; waist: whether they end at their own waistband."""
    field = vertices[:, 2] - leg_height(body, legs.length)
    if waist:
        top = waistband(body, vertices, legs.drop)
        field = np.minimum(np.minimum(field, top), _off_arms(body, vertices))
    return field


def _on_arm(body: Body, vertices: Array) -> NDArray[np.bool_]:
    return (upper_arm_share(body, vertices) > FREE_ARM) | (forearm_share(body, vertices) > -0.5)


def _off_arms(body: Body, vertices: Array) -> Array:
    """Field (P,) m of what is not beyond the elbows sidewards: hands are next to the hips."""
    return abs(joint(body, "LeftForeArm")[0]) - 0.03 - np.abs(vertices[:, 0])


def _slit(pattern: Pattern, skirt: Skirt, body: Body) -> Pattern:
    """Pattern with a wedge cut from the hem of its skirt upwards."""
    bottom = pattern.vertices[:, 2].min()
    top = bottom + skirt.slit_height * (waist_height(body) - skirt.drop - bottom)
    around = pattern.vertices[:, :2] - joint(body, "LowerBack")[:2]
    turned = np.arctan2(around[:, 1], around[:, 0]) - skirt.slit_side
    aside = np.linalg.norm(around, axis=1) * np.abs((turned + np.pi) % (2 * np.pi) - np.pi)
    below = np.clip(top - pattern.vertices[:, 2], -0.1, None)
    edges, along, faces = cut(pattern.faces, aside - 0.5 * skirt.slit * below)
    return Pattern(*largest(place(pattern.vertices, edges, along), faces))
