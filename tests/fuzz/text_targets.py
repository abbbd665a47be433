"""Readers of JSON, tables and lists: outfits, role maps, keypoints, indices, pins."""

import json
from pathlib import Path
from typing import Any

import torch

from tests.fuzz.target import Target, require, require_numbers
from tests.small_body import small_body
from uvcloth.bodies.body import save_body
from uvcloth.dataset.folder import MEMBERS
from uvcloth.garments.garment import Garment
from uvcloth.garments.pins import pinned
from uvcloth.geometry.roles import ROLES, read_role_map
from uvcloth.motion.index import Entry, read_index
from uvcloth.motion.poses import SPLITS
from uvcloth.physics.fabric import FABRICS, RANGES
from uvcloth.simulation.plan_file import PlanRow, read_plan
from uvcloth.tryon.keypoints import BODY_25, FEWEST, Keypoints, read_keypoints
from uvcloth.wardrobe.designs import KINDS, PARTS, Design, limits
from uvcloth.wardrobe.outfit_file import OutfitFile, PieceFile, load_outfit_file, save_outfit_file

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
INDEX = """trial,subject,split,action,window_start,window_frames,file
walk,ann,train,walking,0,115,sub/walk.bvh
jump,cid,validation,"jumping, high",0,54,
run,bob,test,running,20,70,
idle,bob,unused,,0,1,
"""
PLAN = """name,clip,start,frames,hold,garments,body,member,split,subject,action
,walk,0,115,,tops,,,train,ann,walking
walk_stop,walk,0,60,1.5,dress,sub/tall.npz,2,train,ann,"walking, stop"
,jump,0,54,0,bottoms+tops,,0,validation,cid,jumping
"""
ROLE_MAP = '{"hips": "Pelvis", "left_thigh": "LThigh", "right_thigh": "RThigh", "head": "Head"}'


def good_outfit(folder: Path) -> Path:
    (folder / "bodies").mkdir()
    save_body(small_body(), folder / "bodies" / "b01.npz")
    (folder / "o0001_gown.obj").write_text(TRIANGLE)
    parts = {
        part: {name: sum(span) / 2 for name, span in limits(PARTS[part]).items()} for part in KINDS["gown"]
    }
    outfit = OutfitFile(
        path=folder / "o0001.json",
        name="o0001",
        split="train",
        body=folder / "bodies" / "b01.npz",
        seed=3,
        pieces=(PieceFile(folder / "o0001_gown.obj", Design.of("gown", parts), 3),),
        fabric_name="jersey",
        fabric=FABRICS["silk"],
        tightness=0.5,
        even=True,
        seams=False,
        vertex_range=(1000, 2500),
    )
    save_outfit_file(outfit)
    return outfit.path


def check_outfit(outfit: OutfitFile) -> None:
    require(outfit.split in SPLITS and len(outfit.pieces) > 0, "no split, or no pieces")
    require(0 <= outfit.tightness <= 1 and type(outfit.seed) is int, "tightness or seed")
    require(type(outfit.even) is bool and type(outfit.seams) is bool, "a flag that is none")
    require(0 < outfit.vertex_range[0] <= outfit.vertex_range[1] <= 10**6, "vertex range")
    for number, (least, most) in RANGES.items():
        require(least <= getattr(outfit.fabric, number) <= most, f"{number} of the fabric")
    folder = outfit.path.parent.resolve()
    for file in (outfit.body, *(piece.file for piece in outfit.pieces)):
        require(file.resolve().is_relative_to(folder) and file.is_file(), "a file elsewhere")
    for piece in outfit.pieces:
        require(set(piece.design.parameters()) == set(KINDS[piece.design.kind]), "parts of another piece")


def good_role_map(folder: Path) -> Path:
    (folder / "map.json").write_text(ROLE_MAP)
    return folder / "map.json"


def check_role_map(found: dict[str, Any]) -> None:
    require(set(found) <= set(ROLES), "a role that is none")
    require(all(isinstance(name, str) for name in found.values()), "a joint name that is no text")


def good_index(folder: Path) -> Path:
    (folder / "index.csv").write_text(INDEX)
    return folder / "index.csv"


def check_index(entries: dict[str, Entry]) -> None:
    splits: dict[str, str] = {}
    for clip, entry in entries.items():
        texts = (entry.clip, entry.subject, entry.split, entry.action, entry.file)
        require(all(isinstance(text, str) for text in texts), "a text that is none")
        require(clip == entry.clip and clip.isprintable() and "/" not in clip, "a clip's name")
        require(0 <= entry.start < 2**31 and 0 < entry.frames < 2**31, "a window")
        require(entry.split in (*SPLITS, "unused"), "a split that is none")
        if entry.split != "unused":
            require(splits.setdefault(entry.subject, entry.split) == entry.split, "a person in two splits")


def good_plan(folder: Path) -> Path:
    (folder / "plan.csv").write_text(PLAN)
    return folder / "plan.csv"


def check_plan(rows: list[PlanRow]) -> None:
    files = [str(file).casefold() for row in rows for file in row.files]
    require(len(files) == len(set(files)), "two simulations for one file")
    require(
        all(".." not in Path(file).parts and not Path(file).is_absolute() for file in files),
        "a file elsewhere",
    )
    check_index({row.motion.entry.clip: row.motion.entry for row in rows})
    for row in rows:
        require(0.0 <= row.motion.hold <= 60.0 and 0 <= row.member < MEMBERS, "a number out of range")
        require(bool(row.garments) and all(row.names), "a row without a garment")


def good_pins(folder: Path) -> Path:
    (folder / "pins.txt").write_text("0 1 2\n5\n7\n")
    return folder / "pins.txt"


def read_pins(path: Path) -> torch.Tensor:
    body = small_body()
    box = Garment("box", None, body.mesh, body.weights, body.weights, "file")
    return pinned([box], body, [str(path)])


def check_pins(held: torch.Tensor) -> None:
    require(held.shape == (8,) and held.dtype == torch.bool, "pins of another garment")


def good_keypoints(folder: Path) -> Path:
    numbers = [n for i in range(17) for n in (10.0 + 7 * i, 20.0 + 9 * i, 0.9)]
    people = [{"pose_keypoints_2d": numbers}, {"pose_keypoints_2d": numbers[:6] + 45 * [0]}]
    (folder / "photo.json").write_text(json.dumps({"version": 1.3, "people": people}))
    return folder / "photo.json"


def check_keypoints(keypoints: Keypoints) -> None:
    count = len(keypoints.names)
    require(FEWEST <= count == len(set(keypoints.names)) and set(keypoints.names) <= set(BODY_25), "names")
    require_numbers(keypoints.points, (count, 2), "points")
    require_numbers(keypoints.confidences, (count,), "confidences")
    require(bool((keypoints.points.abs() < 1000).all()) and keypoints.torso > 0, "a point far outside")
    require(0 < float(keypoints.confidences.min()) <= float(keypoints.confidences.max()) <= 1, "confidences")


TARGETS = [
    Target("keypoints", good_keypoints, lambda path: read_keypoints(path, (200, 300)), check_keypoints),
    Target("outfit", good_outfit, load_outfit_file, check_outfit),
    Target("role_map", good_role_map, read_role_map, check_role_map),
    Target("index", good_index, read_index, check_index),
    Target("plan", good_plan, read_plan, check_plan),
    Target("pins", good_pins, read_pins, check_pins),
]
