"""Keypoints in files: three layouts, and one sentence for what cannot be used."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from uvcloth.errors import InputError
from uvcloth.tryon.keypoints import COCO_17, LAYOUTS, read_keypoints

SIZE = (200, 300)


def spread(count: int, confidence: float = 1.0, far: float = 1.0) -> list[float]:
    """Numbers of keypoints that are apart."""
    return [n for i in range(count) for n in (10.0 + far * 7 * i, 20.0 + far * 9 * i, confidence)]


def written(path: Path, document: Any) -> Path:
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize("count", LAYOUTS)
def test_all_layouts_are_read(count: int, tmp_path: Path) -> None:
    file = written(tmp_path / "a.json", {"people": [{"pose_keypoints_2d": spread(count)}]})
    keypoints = read_keypoints(file, SIZE)
    assert keypoints.names == LAYOUTS[count]
    wrist = keypoints.names.index("left_wrist")
    assert keypoints.points[wrist].tolist() == [10.0 + 7 * wrist, 20.0 + 9 * wrist]


@pytest.mark.parametrize("shape", ["list", "annotations", "alone"])
def test_documents_of_coco_are_read(shape: str, tmp_path: Path) -> None:
    small, large = ({"keypoints": spread(17, 2.0, far), "category_id": 1} for far in (0.5, 1.0))
    document = {"list": [small, large], "annotations": {"annotations": [small, large]}, "alone": large}[shape]
    keypoints = read_keypoints(written(tmp_path / "a.json", document), SIZE)
    assert keypoints.names == COCO_17
    assert keypoints.people == (1 if shape == "alone" else 2)
    assert keypoints.points[1].tolist() == [17.0, 29.0]  # of the large one
    assert keypoints.confidences.max() == 1.0


FEW = spread(17)
FEW[2::3] = [0.9] * 7 + [0.1] * 10

BAD = [
    ({"people": []}, "holds no person"),
    ([], "holds no person"),
    ({"version": 1}, "neither people nor annotations"),
    ({"people": [{}]}, "lacks 'pose_keypoints_2d'"),
    ({"people": [{"pose_keypoints_2d": [1, 2]}]}, "has 2 numbers, expected 75 or 54 or 51"),
    ({"people": [{"pose_keypoints_2d": ["x"] * 51}]}, "expected a whole number or a number"),
    ({"people": [{"pose_keypoints_2d": FEW}]}, "7 keypoints, 2 of shoulders and hips"),
    ({"people": [{"pose_keypoints_2d": spread(17, far=3.0)}]}, "outside the photograph of 200 x 300 pixels"),
    ({"people": [{"pose_keypoints_2d": spread(17, far=0.001)}]}, "the torso is 0.1 pixels long"),
]


@pytest.mark.parametrize(("document", "sentence"), BAD, ids=[sentence for _, sentence in BAD])
def test_bad_files_are_refused(document: Any, sentence: str, tmp_path: Path) -> None:
    file = written(tmp_path / "a.json", document)
    with pytest.raises(InputError, match=f"^{re.escape(str(file))}.*{re.escape(sentence)}"):
        read_keypoints(file, SIZE)
