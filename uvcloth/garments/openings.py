"""Openings of garments: fields over points around a body that are positive on the side that the cloth is on.

`cut` clips a shell along their zero level, and the least of several keeps what all of them keep.
"""

import numpy as np
from numpy.typing import NDArray

from uvcloth.bodies.body import Body
from uvcloth.garments.shells import joint

Array = NDArray[np.float64]

ARM_RADIUS = 0.115
"""Metres from a bone of the arm within which a point is on the arm."""

NECK_SLOPE = 0.42
"""Metres that a crew neck is lower for each metre forwards."""

WAIST_SLOPE = 0.12
"""Metres that a waistband is lower for each metre forwards."""


def waist_height(body: Body) -> float:
    """Height of the waist, m. Raises InputError as `joint` does, as all functions here."""
    return float(joint(body, "LowerBack")[2] + 0.05)


def waistband(body: Body, vertices: Array, drop: float) -> Array:
    """Field (P,) m of what lies below a waistband `drop` metres below the waist, lower in front."""
    return (
        waist_height(body)
        - drop
        + WAIST_SLOPE * (vertices[:, 1] - joint(body, "LowerBack")[1])
        - (vertices[:, 2])
    )


def neck(body: Body, vertices: Array, drop: float) -> Array:
    """Field (P,) m of a crew neck: a plane through the base of the neck, lower in front."""
    base = joint(body, "Neck")
    return base[2] + 0.012 - drop + NECK_SLOPE * (vertices[:, 1] - base[1]) - vertices[:, 2]


def sleeves(body: Body, vertices: Array, length: float) -> Array:
    """Field (P,) m of sleeves; length: up to 1 a share of the upper arm, then 1 and one of the forearm."""
    shoulder, elbow, wrist = (joint(body, name) for name in ("LeftArm", "LeftForeArm", "LeftHand"))
    if length <= 1.0:
        return (length - upper_arm_share(body, vertices)) * float(np.linalg.norm(elbow - shoulder))
    return (length - 1.0 - forearm_share(body, vertices)) * float(np.linalg.norm(wrist - elbow))


def upper_arm_share(body: Body, vertices: Array) -> Array:
    """Place of points along an upper arm: (P,), 0 at the shoulder, 1 at the elbow, -1 off both arms."""
    longest = np.full(len(vertices), -1.0)
    for side in ("Left", "Right"):
        shoulder, elbow = joint(body, f"{side}Arm"), joint(body, f"{side}ForeArm")
        share, away = _along(vertices, shoulder, elbow)
        limb = (away < ARM_RADIUS) | (share > 1.0) & (np.abs(vertices[:, 0]) > abs(elbow[0]) - 0.08)
        longest = np.maximum(longest, np.where(limb & (vertices[:, 0] * shoulder[0] > 0), share, -1.0))
    return longest


def forearm_share(body: Body, vertices: Array) -> Array:
    """Place of points along a forearm: (P,), 0 at the elbow, 1 at the wrist, -1 off both."""
    longest = np.full(len(vertices), -1.0)
    for side in ("Left", "Right"):
        share, away = _along(vertices, joint(body, f"{side}ForeArm"), joint(body, f"{side}Hand"))
        longest = np.where(away < ARM_RADIUS, np.maximum(longest, share), longest)
    return longest


def _along(vertices: Array, start: Array, end: Array) -> tuple[Array, Array]:
    """Place of points along a bone (P,), 0 at its start, 1 at its end, and metres (P,) from its line."""
    axis = end - start
    share = (vertices - start) @ axis / (axis @ axis)
    return share, np.linalg.norm(vertices - start - share[:, None] * axis, axis=1)
