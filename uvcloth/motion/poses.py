"""Pose databases: distinct, valid poses of one body, without the motion between them, in one npz."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays
from uvcloth.files.fields import check_fields, flags, indices, names, numbers, whole
from uvcloth.geometry.rotations import are_unit, from_quaternions, to_quaternions
from uvcloth.geometry.skeleton import Skeleton, joint_transforms

SPLITS = ("train", "validation", "test")

POSES_FORMAT = "uvcloth-poses-2"
DONORS = 4
"""Number of poses that a recombined one is made of."""

FIELDS = {
    "joint_names": names("J"),
    "quaternions": numbers("M", "J", 4),
    "clip_names": names("C"),
    "subjects": names("C"),
    "clips": indices("M", of="C"),
    "frames": whole("M"),
    "mirrored": flags("M"),
    "splits": whole("M", most=len(SPLITS) - 1),
    "donors": indices("M", DONORS, of="M", least=-1),
    "apart": numbers(least=0.0, dtype=np.float64),
    "body_name": names(),
    "body_hash": names(),
}
"""Arrays of a file: M poses, J joints, C clips."""

PER_POSE = ("rotations", "clips", "frames", "mirrored", "splits", "donors")


@dataclass(frozen=True)
class PoseDatabase:
    """M poses of a skeleton of J joints (PBNS section 4.3).

    joints: names. rotations: (M, J, 3, 3) float32 world rotations relative to rest. clip_names: the clips
    that they come from. subjects: the captured person of each clip, "" if unknown. clips: (M,) int64
    index of the clip. frames: (M,) int64 frame of it at 30 frames per second. mirrored: (M,) bool, left and
    right swapped. splits: (M,) int64 indices into SPLITS. donors: (M, DONORS) int64 the poses of the file
    whose legs, trunk, left and right arm a recombined one has (clip, frame and mirrored are those of the
    legs), -1 for one that was drawn. apart: radians by which any two that were drawn differ at least.
    body_name, body_hash: name and shape of the body that they are valid for, see `BodyIdentity`.
    """

    joints: tuple[str, ...]
    rotations: Tensor
    clip_names: tuple[str, ...]
    subjects: tuple[str, ...]
    clips: Tensor
    frames: Tensor
    mirrored: Tensor
    splits: Tensor
    donors: Tensor
    apart: float
    body_name: str
    body_hash: str

    def __len__(self) -> int:
        return len(self.rotations)

    def transforms(self, skeleton: Skeleton) -> Tensor:
        """Rest-to-posed transforms of every joint, the root joint where it is at rest: (M, J, 3, 4)."""
        return joint_transforms(skeleton, self.rotations, skeleton.heads[:1].expand(len(self), 3))

    def of(self, split: str) -> "PoseDatabase":
        """Poses of one split, a word of SPLITS."""
        return self.select(torch.nonzero(self.splits == SPLITS.index(split)).squeeze(1))

    def clips_of(self, split: str) -> dict[str, str]:
        """Clips of the poses of a split, and the subject of each."""
        clips = self.of(split).clips.unique().tolist()
        return {self.clip_names[clip]: self.subjects[clip] for clip in clips}

    def select(self, rows: Tensor) -> "PoseDatabase":
        """Poses at `rows` (K,), in that order."""
        taken: dict[str, Any] = {name: getattr(self, name)[rows] for name in PER_POSE}
        return replace(self, **taken)

    def followed_by(self, other: "PoseDatabase") -> "PoseDatabase":
        """Poses of this database, then those of another one of the same clips."""
        joined: dict[str, Any] = {
            name: torch.cat([getattr(self, name), getattr(other, name)]) for name in PER_POSE
        }
        return replace(self, **joined)


def save_poses(poses: PoseDatabase, path: Path) -> None:
    """Write a database to one npz, rotations as quaternions. Raises InputError if it cannot be written."""
    save_arrays(
        path,
        {
            "format": np.array(POSES_FORMAT),
            "joint_names": np.array(poses.joints),
            "quaternions": to_quaternions(poses.rotations).float().numpy(),
            "clip_names": np.array(poses.clip_names),
            "subjects": np.array(poses.subjects),
            "clips": poses.clips.numpy().astype(np.int32),
            "frames": poses.frames.numpy().astype(np.int32),
            "mirrored": poses.mirrored.numpy(),
            "splits": poses.splits.numpy().astype(np.uint8),
            "donors": poses.donors.numpy().astype(np.int32),
            "apart": np.array(poses.apart),
            "body_name": np.array(poses.body_name),
            "body_hash": np.array(poses.body_hash),
        },
    )


def load_poses(path: Path, body: Body) -> PoseDatabase:
    """Read the file that `save_poses` wrote, for a body.

    Raises InputError naming the file if it is missing, damaged, another format, without poses, made for
    another skeleton, or holds arrays that do not fit together or are not finite.
    """
    path = Path(path)
    data = check_fields(path, load_arrays(path, POSES_FORMAT, "poses drawn by `uvcloth poses`"), FIELDS)
    joints = tuple(map(str, data["joint_names"]))
    if joints != body.skeleton.names:
        raise InputError(
            f"{path}: the poses have another skeleton than the body {body.name} "
            f"({len(joints)} joints {', '.join(joints[:3])}, ...)"
        )
    if not len(data["quaternions"]):
        raise InputError(f"{path}: holds no poses")
    quaternions = torch.from_numpy(data["quaternions"])
    if not are_unit(quaternions):
        raise InputError(f"{path}: a rotation of the poses is not a unit quaternion")
    return PoseDatabase(
        joints=joints,
        rotations=from_quaternions(quaternions.double()).float(),
        clip_names=tuple(str(name) for name in data["clip_names"]),
        subjects=tuple(str(name) for name in data["subjects"]),
        clips=torch.from_numpy(data["clips"]),
        frames=torch.from_numpy(data["frames"]),
        mirrored=torch.from_numpy(data["mirrored"]),
        splits=torch.from_numpy(data["splits"]),
        donors=torch.from_numpy(data["donors"]),
        apart=float(data["apart"]),
        body_name=str(data["body_name"]),
        body_hash=str(data["body_hash"]),
    )
