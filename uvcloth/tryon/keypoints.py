"""Keypoints of a person in a photograph, from the JSON of OpenPose or COCO."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.files.json_file import read_json_document, require_kinds

BODY_25 = (
    *("nose", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow"),
    *("left_wrist", "middle_hip", "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee"),
    *("left_ankle", "right_eye", "left_eye", "right_ear", "left_ear", "left_big_toe", "left_small_toe"),
    *("left_heel", "right_big_toe", "right_small_toe", "right_heel"),
)
COCO_18 = (
    *("nose", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow"),
    *("left_wrist", "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle"),
    *("right_eye", "left_eye", "right_ear", "left_ear"),
)
COCO_17 = (
    *("nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder"),
    *("left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hip", "right_hip", "left_knee"),
    *("right_knee", "left_ankle", "right_ankle"),
)
LAYOUTS = {len(names): names for names in (BODY_25, COCO_18, COCO_17)}
"""Names of keypoints in their order, by number: OpenPose's two layouts, and that of COCO."""

TORSO = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")

CONFIDENT = 0.3
"""Least confidence of a keypoint that is used."""

FEWEST = 8
"""Least number of such keypoints, with which a pose is fitted."""

MARGIN = 0.1
"""Share of the photograph's size by which a keypoint may lie outside: detectors guess beyond the edge."""

SMALLEST = 20.0
"""Least length of the torso in pixels."""

EXPECTED = "keypoints of OpenPose (BODY_25 or COCO) or COCO"


@dataclass(frozen=True)
class Keypoints:
    """Confident keypoints of one person.

    names: K words of BODY_25. points: (K, 2) pixels, x to the right and y down. confidences: (K,), of which
    1 is the greatest. people: number of persons in the file.
    """

    names: tuple[str, ...]
    points: Tensor
    confidences: Tensor
    people: int = 1

    @property
    def torso(self) -> float:
        """Length of the torso in pixels: the greatest distance of two of its corners."""
        corners = self.points[[name in TORSO for name in self.names]]
        return float(torch.cdist(corners, corners).max())


def read_keypoints(path: Path, size: tuple[int, int]) -> Keypoints:
    """Read the keypoints of the largest person in a file.

    size: (width, height) of the photograph in pixels. Raises InputError naming the file for JSON of another
    format or without a person, fewer than FEWEST confident keypoints, fewer than three corners of the torso,
    and a person who is too small or outside the photograph.
    """
    people = [_person(path, numbers) for numbers in _people(path)]
    if not people:
        raise InputError(f"{path}: holds no person")
    person = max(people, key=_extent)
    corners = sum(name in TORSO for name in person.names)
    if len(person.names) < FEWEST or corners < 3:
        raise InputError(
            f"{path}: {len(person.names)} keypoints, {corners} of shoulders and hips, have a confidence of "
            f"{CONFIDENT} or more, expected at least {FEWEST} and 3"
        )
    for name, (x, y) in zip(person.names, person.points.tolist(), strict=True):
        inside = all(
            -MARGIN * side <= place <= (1 + MARGIN) * side for place, side in zip((x, y), size, strict=True)
        )
        if not inside:
            raise InputError(
                f"{path}: {name} is at {x:.0f}, {y:.0f}, outside the photograph of {size[0]} x "
                f"{size[1]} pixels"
            )
    if person.torso < SMALLEST:
        raise InputError(
            f"{path}: the torso is {person.torso:.1f} pixels long, expected at least {SMALLEST:.0f} pixels "
            "of the photograph"
        )
    return Keypoints(person.names, person.points, person.confidences, len(people))


def _people(path: Path) -> list[list[float]]:
    """The numbers of each person's keypoints, three for each keypoint."""
    document = read_json_document(path, EXPECTED)
    if isinstance(document, dict) and "people" in document:
        key, people = "pose_keypoints_2d", document["people"]
    else:
        alone = isinstance(document, dict) and "keypoints" in document
        listed = document.get("annotations") if isinstance(document, dict) else document
        key, people = "keypoints", [document] if alone else listed
    if not isinstance(people, list):
        raise InputError(f"{path}: has neither people nor annotations, expected {EXPECTED}")
    number: Any = (int, float)
    for index, person in enumerate(people):
        require_kinds(person, {key: [number]}, f"{path}: person {index}")
    return [person[key] for person in people]


def _person(path: Path, numbers: list[float]) -> Keypoints:
    names = LAYOUTS.get(len(numbers) // 3)
    if names is None or len(numbers) % 3:
        known = " or ".join(str(3 * count) for count in LAYOUTS)
        raise InputError(f"{path}: a person has {len(numbers)} numbers, expected {known}: {EXPECTED}")
    values = torch.tensor(numbers, dtype=torch.float64).view(-1, 3)
    certain = values[:, 2] >= CONFIDENT
    kept = tuple(name for name, use in zip(names, certain.tolist(), strict=True) if use)
    # COCO's annotations count visibility to 2.
    return Keypoints(kept, values[certain, :2].float(), values[certain, 2].clamp(max=1.0).float())


def _extent(person: Keypoints) -> float:
    """Diagonal of the box around the keypoints, in pixels."""
    points = person.points
    return float((points.amax(0) - points.amin(0)).norm()) if len(points) else 0.0
