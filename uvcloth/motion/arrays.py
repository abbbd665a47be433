"""Motions from arrays: joint transforms of a body, as engines and other libraries have them."""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.files.fields import check_fields, numbers
from uvcloth.geometry.arrays import Array, as_array
from uvcloth.geometry.skeleton import joint_transforms
from uvcloth.motion.clip import Clip, require_fps
from uvcloth.motion.posture import require_near

LAST_ROW = (0.0, 0.0, 0.0, 1.0)
"""Last row of an affine 4 x 4 matrix."""

ROTATION_TOLERANCE = 1e-3
"""Largest difference of an entry of a rotation times its transpose from the identity."""

JOINT_TOLERANCE = 1e-3
"""Greatest distance, metres, of a joint from the end of the bone above it."""


def clip_of_transforms(transforms: Array, body: Body, fps: float, name: str = "motion") -> Clip:
    """Make a motion of a body from its joint transforms in every frame.

    transforms: (F, J, 3, 4) or (F, J, 4, 4), from the rest pose to the posed one, metres, Z up, in the order
    of the body's joints. fps: frames per second. The clip has the same positions, in float64.
    Raises InputError naming the motion, and the joint and frame, for another shape, another number of joints,
    no frames, a value that is not a finite number, a frame rate out of FPS_RANGE, a matrix that is not a
    rotation and translation, a joint that leaves the bone above it, and a person too far from the origin.
    """
    require_fps(fps)
    joints = len(body.skeleton.names)
    given = as_array(name, "transforms", transforms)
    rows = 4 if given.ndim == 4 and given.shape[2] == 4 else 3
    if given.ndim == 4 and given.shape[1] != joints:
        raise InputError(f"{name}: has {given.shape[1]} joints, the body {body.name} has {joints}")
    fields = {"transforms": numbers("F", "J", rows, 4, dtype=np.float64)}
    matrices = torch.from_numpy(
        check_fields(Path(name), {"transforms": given}, fields, J=joints)["transforms"]
    )
    if not len(matrices):
        raise InputError(f"{name}: the clip has zero frames")
    if rows == 4:
        wrong = (matrices[:, :, 3] - torch.tensor(LAST_ROW)).abs().amax(-1) > ROTATION_TOLERANCE
        _refuse(wrong, body, name, "a matrix whose last row is not 0, 0, 0, 1 (is it transposed?)")
    rotations, shifts = matrices[:, :, :3, :3], matrices[:, :, :3, 3]
    off = (rotations @ rotations.mT - torch.eye(3)).abs().amax((-1, -2)) > ROTATION_TOLERANCE
    _refuse(off | (torch.linalg.det(rotations) < 0), body, name, "a matrix that scales, shears or mirrors")
    root = rotations[:, 0] @ body.skeleton.heads[0].double() + shifts[:, 0]
    clip = Clip(name, body.skeleton, rotations.contiguous(), root, float(fps))
    held = joint_transforms(body.skeleton, clip.rotations, root)[..., 3]
    apart = (held - shifts).norm(dim=-1) > JOINT_TOLERANCE
    _refuse(apart, body, name, f"left the bone above it by more than {1000 * JOINT_TOLERANCE:.0f} mm")
    try:
        require_near(clip)
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
    return clip


def _refuse(wrong: Tensor, body: Body, name: str, fault: str) -> None:
    """Raise InputError naming the first joint and frame of a mask (F, J), if there is one."""
    if bool(wrong.any()):
        frame, joint = torch.nonzero(wrong)[0].tolist()
        raise InputError(
            f"{name}: joint {body.skeleton.names[joint]} in frame {frame} has {fault}; expected transforms "
            "from the body's rest pose"
        )
