"""A made-up person in the schema of SMPL's model files: capsules around bones, no data of SMPL's."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
from skimage.measure import marching_cubes

from uvcloth.bodies.smpl_joints import HANDS, SMPL_JOINTS

CORRECTED = ("hip", "knee", "shoulder", "elbow")
"""Joints whose turns correct the skin."""

MIDDLE = {
    "pelvis": (0.0, -0.2, 0.02), "spine1": (0.0, -0.08, 0.0), "spine2": (0.0, 0.06, 0.0),
    "spine3": (0.0, 0.12, 0.0), "neck": (0.0, 0.32, 0.0), "head": (0.0, 0.42, 0.03), "jaw": (0.0, 0.42, 0.05),
}  # fmt: skip
LEFT = {
    "hip": (0.09, -0.28, 0.01), "knee": (0.1, -0.68, 0.015), "ankle": (0.1, -1.08, -0.02),
    "foot": (0.11, -1.13, 0.1), "collar": (0.07, 0.24, 0.0), "shoulder": (0.18, 0.26, 0.0),
    "elbow": (0.44, 0.25, -0.01), "wrist": (0.69, 0.25, 0.0), "hand": (0.77, 0.25, 0.0),
    "eye_smplhf": (0.03, 0.47, 0.08),
}  # fmt: skip
"""Joints of a T-pose, metres, Y up, facing +Z; the right side is the mirror image."""

BONES = (
    ("pelvis", "spine2", 0.125), ("spine2", "spine3", 0.12), ("spine3", "neck", 0.09), ("neck", "head", 0.06),
    ("head", (0.0, 0.5, 0.03), 0.09), ("hip", "knee", 0.07), ("knee", "ankle", 0.05),
    ("ankle", "foot", 0.04), ("foot", (0.11, -1.13, 0.15), 0.035), ("collar", "shoulder", 0.07),
    ("shoulder", "elbow", 0.052), ("elbow", "wrist", 0.042), ("wrist", "hand", 0.036),
    ("hand", (0.84, 0.25, 0.0), 0.03), ("pelvis", "hip", 0.1),
)  # fmt: skip
"""Bones from a joint to another or to a point, and their radius."""


def smpl_arrays(kind: str = "SMPL", voxel: float = 0.03) -> dict[str, np.ndarray]:
    """Arrays of a model file; of 10 shapes the first makes the person a tenth taller and wider.

    voxel: metres between the points at which the distance from the bones is known; from 0.03 on hands fall
    off.
    """
    rng = np.random.default_rng(0)
    names = SMPL_JOINTS[kind]
    joints = np.array([_place(name) for name in names])
    vertices, faces, distances = _surface(names, voxel)
    nearness = np.exp(-distances / 0.025)
    nearness[nearness < 0.05 * nearness.max(1, keepdims=True)] = 0.0
    shapes = 0.01 * rng.standard_normal((len(vertices), 3, 10))
    shapes[..., 0] = 0.1 * vertices
    parents = [_parent(name, names) for name in names]
    corrections = np.zeros((len(vertices), 3, len(names) - 1, 9))
    for joint, name in enumerate(names[1:]):
        if name.endswith(CORRECTED):
            corrections[:, :, joint] = 0.004 * rng.standard_normal((len(vertices), 3, 9)).round(1)
    return {
        "v_template": vertices,
        "f": faces.astype(np.uint32),
        "shapedirs": shapes,
        "posedirs": corrections.reshape(len(vertices), 3, -1),
        "weights": nearness / nearness.sum(1, keepdims=True),
        "J_regressor": _regressor(vertices, joints),
        "kintree_table": np.array([[4294967295, *parents[1:]], range(len(names))], dtype=np.uint32),
    }


def write_npz(path: Path, arrays: dict[str, np.ndarray]) -> Path:
    """An npz as of SMPL-H and SMPL-X, with an entry beside that only unpickling could read."""
    np.savez(path, **arrays, joint2num=np.array({"Pelvis": 0}, dtype=object))
    return path


def write_pickle(path: Path, arrays: dict[str, Any], protocol: int = 2) -> Path:
    path.write_bytes(pickle.dumps(arrays, protocol=protocol))
    return path


def smpl_vertices(
    arrays: dict[str, np.ndarray], betas: np.ndarray, pose: np.ndarray, trans: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Posed vertices (V, 3) and joints (J, 3) by SMPL's equations, in its axes and in float64.

    pose: (J, 3) axis-angles relative to the parents. trans: (3,).
    """
    shaped = arrays["v_template"] + arrays["shapedirs"][..., : len(betas)] @ betas
    joints = arrays["J_regressor"] @ shaped
    local = np.array([_rodrigues(turn) for turn in pose])
    corrected = shaped + arrays["posedirs"] @ (local[1:] - np.eye(3)).ravel()
    world: list[np.ndarray] = []
    for joint, parent in enumerate(arrays["kintree_table"][0]):
        own = np.eye(4)
        own[:3, :3], own[:3, 3] = local[joint], joints[joint] - (joints[parent] if joint else 0.0)
        world.append(world[parent] @ own if joint else own)
    posed = np.array([each[:3, 3] for each in world])
    skinning = np.array(world)[:, :3]
    skinning[..., 3] -= np.einsum("jab,jb->ja", skinning[..., :3], joints)
    blended = np.einsum("vj,jab->vab", arrays["weights"], skinning)
    return np.einsum("vab,vb->va", blended[..., :3], corrected) + blended[..., 3] + trans, posed + trans


def _rodrigues(turn: np.ndarray) -> np.ndarray:
    angle = np.linalg.norm(turn)
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = turn / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def _place(name: str) -> np.ndarray:
    if name in MIDDLE:
        return np.array(MIDDLE[name])
    side, _, part = name.partition("_")
    if name in HANDS:
        finger, segment = HANDS.index(name) // 3 % 5, int(name[-1])
        place = np.array([0.75 + 0.022 * segment, 0.25, 0.012 * (finger - 2)])
    else:
        place = np.array(LEFT[part])
    return place * [1 if side == "left" else -1, 1, 1]


def _parent(name: str, names: tuple[str, ...]) -> int:
    above = {
        "spine1": "pelvis", "spine2": "spine1", "spine3": "spine2", "neck": "spine3", "head": "neck",
        "hip": "pelvis", "knee": "hip", "ankle": "knee", "foot": "ankle", "collar": "spine3",
        "shoulder": "collar", "elbow": "shoulder", "wrist": "elbow", "hand": "wrist", "jaw": "head",
        "eye_smplhf": "head", "pelvis": "pelvis",
    }  # fmt: skip
    side, _, part = name.partition("_")
    if name in HANDS:
        return names.index(f"{side}_wrist" if name[-1] == "1" else f"{name[:-1]}{int(name[-1]) - 1}")
    parent = above[part or name]
    return names.index(parent if parent in names else f"{side}_{parent}")


def _surface(names: tuple[str, ...], voxel: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (V, 3), faces (F, 3) of the closed surface, and distances (V, J) from each joint's bones."""
    low, high = np.array([-1.003, -1.307, -0.251]), np.array([1.0, 0.7, 0.3])
    axes = [np.arange(a, b, voxel) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    field = _distances(grid.reshape(-1, 3), names).min(1).reshape(grid.shape[:3])
    vertices, faces, _, _ = marching_cubes(field, 0.0, spacing=(voxel,) * 3, gradient_direction="descent")
    vertices = vertices.astype(np.float64) + low
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    volume = (corners[:, 0] * normals).sum() / 6
    return vertices, faces if volume > 0 else faces[:, ::-1], _distances(vertices, names)


def _distances(points: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    distances = np.full((len(points), len(names)), np.inf)
    for start, end, radius in BONES:
        sides = (
            ("",) if start in MIDDLE and not (isinstance(end, str) and end in LEFT) else ("left_", "right_")
        )
        for side in sides:
            joint = start if start in MIDDLE else side + start
            first = _place(joint)
            if isinstance(end, str):
                last = _place(end if end in MIDDLE else side + end)
            else:
                last = np.array(end) * [-1 if side == "right_" else 1, 1, 1]
            if joint not in names:
                joint = f"{side}wrist"
            along = last - first
            share = ((points - first) @ along / (along @ along)).clip(0, 1)
            away = np.linalg.norm(points - first - share[:, None] * along, axis=1) - radius
            column = names.index(joint)
            distances[:, column] = np.minimum(distances[:, column], away)
    return distances


def _regressor(vertices: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Weights (J, V), rows of sum one, of the vertices around each joint that have their mean at it."""
    regressor = np.zeros((len(joints), len(vertices)))
    for joint, place in enumerate(joints):
        near = np.argsort(np.linalg.norm(vertices - place, axis=1))[:60]
        system = np.vstack([vertices[near].T, np.ones(len(near))])
        regressor[joint, near] = np.linalg.pinv(system) @ np.append(place, 1.0)
    return regressor
