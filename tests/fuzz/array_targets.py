"""Readers of npz files: bodies, clips, sequences, poses, layouts."""

from dataclasses import replace
from pathlib import Path
from shutil import rmtree

import numpy as np
import torch

from rasterize.layout import Layout
from tests.fuzz.target import Target, require, require_indices, require_numbers
from tests.layout_file import save_layout
from tests.small_body import small_body
from uvcloth.bodies.body import Body, load_body, resized, save_body
from uvcloth.bodies.difference import load_kept_body, save_difference
from uvcloth.dataset.bodies import keep_body
from uvcloth.dataset.clip import SimulatedClip, clip_of_garment, flat_metadata
from uvcloth.dataset.clip_file import load_simulated, read_metadata, save_simulated
from uvcloth.dataset.packed import PackedFolder, load_packed, pack_folder
from uvcloth.formats.layout_file import load_layout
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.motion.clip import Clip
from uvcloth.motion.library import read_archive, save_clip
from uvcloth.motion.poses import DONORS, SPLITS, PoseDatabase, load_poses, save_poses

FRAMES = 5


def good_body(folder: Path) -> Path:
    body = small_body()
    from uvcloth.bodies.body import Appearance, Proxy

    full = replace(
        body,
        proxies={"suit": Proxy(body.mesh.vertices * 1.1, body.mesh.faces, body.weights)},
        base=body.mesh.vertices,
        appearance=Appearance(body.mesh, body.weights),
        pose_shapes=torch.zeros(9, len(body.mesh.vertices), 3),
    )
    save_body(full, folder / "body.npz")
    return folder / "body.npz"


def good_difference(folder: Path) -> Path:
    save_difference(resized(load_body(), 1.05), folder / "body.npz")
    return folder / "body.npz"


def check_mesh(mesh: Mesh, what: str) -> None:
    require_numbers(mesh.vertices, (-1, 3), f"{what} vertices")
    require_indices(mesh.faces, (-1, 3), len(mesh.vertices), f"{what} faces")
    require_numbers(mesh.uvs, (-1, 2), f"{what} uvs")
    require_indices(mesh.face_uvs, (-1, 3), len(mesh.uvs), f"{what} face_uvs")
    require(len(mesh.face_uvs) in (0, len(mesh.faces)), f"{what} face_uvs of other faces")


def check_weights(weights: torch.Tensor, vertices: int, joints: int, what: str) -> None:
    require_numbers(weights, (vertices, joints), what)
    require((weights >= 0).all() and ((weights.sum(1) - 1).abs() < 1e-3).all(), f"{what} do not sum to one")


def check_skeleton(skeleton: Skeleton) -> None:
    count = len(skeleton.names)
    require(count > 0, "no joints")
    require_numbers(skeleton.heads, (count, 3), "joint heads")
    require(len(skeleton.parents) == count, "parents of other joints")
    require(all(-1 <= p < j for j, p in enumerate(skeleton.parents)), "a parent after its joint")


def check_body(body: Body) -> None:
    vertices, joints = len(body.mesh.vertices), len(body.skeleton.names)
    check_mesh(body.mesh, "body")
    require(vertices > 0 and len(body.mesh.faces) > 0, "an empty body")
    check_skeleton(body.skeleton)
    check_weights(body.weights, vertices, joints, "weights")
    require_indices(body.regions, (len(body.mesh.faces),), 8, "regions")
    require_indices(body.sides + 1, (len(body.mesh.faces),), 3, "sides")
    for name, proxy in body.proxies.items():
        require_numbers(proxy.vertices, (-1, 3), name)
        require_indices(proxy.faces, (-1, 3), len(proxy.vertices), name)
        check_weights(proxy.weights, len(proxy.vertices), joints, name)
    if body.base is not None:
        require_numbers(body.base, (-1, 3), "base")
    if body.appearance is not None:
        check_mesh(body.appearance.mesh, "appearance")
        check_weights(body.appearance.weights, len(body.appearance.mesh.vertices), joints, "appearance")
    if body.pose_shapes is not None:
        require_numbers(body.pose_shapes, (9 * (joints - 1), vertices, 3), "pose shapes")


def good_clip(folder: Path) -> Path:
    rotations = torch.eye(3).expand(FRAMES, 2, 3, 3)
    save_clip(
        Clip("walk", small_body().skeleton, rotations, torch.zeros(FRAMES, 3), 30.0), folder / "walk.npz"
    )
    return folder / "walk.npz"


def check_rotations(rotations: torch.Tensor, shape: tuple[int, ...]) -> None:
    require_numbers(rotations, shape, "rotations")
    require(((rotations @ rotations.mT - torch.eye(3)).abs() < 1e-2).all(), "a rotation is none")


def check_clip(clip: Clip) -> None:
    check_skeleton(clip.skeleton)
    require(len(clip) > 0, "no frames")
    check_rotations(clip.rotations, (-1, len(clip.skeleton.names), 3, 3))
    require_numbers(clip.translation.double(), (len(clip), 3), "translation", torch.float64)
    require(0.1 <= clip.fps <= 10_000, f"{clip.fps} frames per second")


def good_amass(folder: Path) -> Path:
    np.savez(
        folder / "walk_poses.npz",
        poses=0.1 * np.random.default_rng(0).standard_normal((FRAMES, 156)),
        trans=np.zeros((FRAMES, 3)),
        mocap_framerate=np.array(120.0),
        betas=np.zeros(16),
        gender=np.array("neutral"),
    )
    return folder / "walk_poses.npz"


def good_amass_x(folder: Path) -> Path:
    arrays = {"root_orient": 3, "pose_body": 63, "pose_jaw": 3, "pose_eye": 6, "pose_hand": 90, "trans": 3}
    random = np.random.default_rng(0)
    values = {name: 0.1 * random.standard_normal((FRAMES, width)) for name, width in arrays.items()}
    np.savez(folder / "walk_stageii.npz", mocap_frame_rate=np.array(120.0), **values)
    return folder / "walk_stageii.npz"


def good_sequence(folder: Path) -> Path:
    mesh = small_body().mesh
    moved = mesh.vertices + 0.01 * torch.arange(FRAMES)[:, None, None]
    still = torch.eye(3, 4).expand(FRAMES, 2, 3, 4)
    metadata = {
        "clip": "walk",
        "garment": "dress",
        "template": "dress",
        "layers": ["bottoms", "dress"],
        "body": "box",
        "body_hash": "0" * 64,
        "engine": "newton",
        "settings": {"fabric": {"density": 0.2}},
        "seed": 0,
        "wrong_side_percent": {"bottoms": 0.5},
    }
    sequence = clip_of_garment(moved, mesh.faces, mesh.vertices, still, 30.0, 2, metadata)
    save_simulated(sequence, folder / "walk_dress.npz")
    return folder / "walk_dress.npz"


def check_sequence(sequence: SimulatedClip) -> None:
    (garment,) = sequence.garments
    frames, count = len(garment.vertices), len(garment.rest)
    require(frames > 0, "no frames")
    require_numbers(garment.vertices, (frames, count, 3), "vertices")
    require_numbers(garment.rest, (count, 3), "rest")
    require_indices(garment.faces, (-1, 3), count, "faces")
    require_numbers(sequence.transforms, (frames, -1, 3, 4), "transforms")
    require(0.1 <= sequence.fps <= 10_000, f"{sequence.fps} frames per second")
    require(0 <= sequence.warm_up < frames, f"{sequence.warm_up} settling frames of {frames}")
    check_metadata(flat_metadata(sequence, garment))
    require(all(isinstance(name, str) for name in sequence.layers), "layers that are no names")


def check_metadata(metadata: dict) -> None:
    require(isinstance(metadata["clip"], str) and isinstance(metadata["garment"], str), "no names")
    require(isinstance(metadata.get("layers", []), list), "layers that are no list")


def good_packed(folder: Path) -> Path:
    sequence = load_simulated(good_sequence(folder))
    body = small_body()
    on_body = sequence.labelled(body=body.name, body_hash=body.identity.shape)
    save_simulated(on_body, folder / "made" / "walk_dress.npz")
    (folder / "walk_dress.npz").unlink()
    keep_body(body, folder / "made")
    pack_folder(folder / "made", folder)
    rmtree(folder / "made")
    return folder / "walk_dress.npz"


def read_packed(path: Path) -> SimulatedClip:
    return load_packed(path, PackedFolder(path.parent))


def good_poses(folder: Path) -> Path:
    body = small_body()
    poses = PoseDatabase(
        joints=body.skeleton.names,
        rotations=torch.eye(3).expand(FRAMES, 2, 3, 3),
        clip_names=("walk", "run"),
        subjects=("ann", ""),
        clips=torch.arange(FRAMES) % 2,
        frames=torch.arange(FRAMES),
        mirrored=torch.arange(FRAMES) % 2 == 0,
        splits=torch.arange(FRAMES) % 3,
        donors=torch.full((FRAMES, DONORS), -1),
        apart=0.1,
        body_name="box",
        body_hash=body.identity.shape,
    )
    save_poses(poses, folder / "poses.npz")
    return folder / "poses.npz"


def check_poses(poses: PoseDatabase) -> None:
    count = len(poses)
    require(count > 0, "no poses")
    check_rotations(poses.rotations, (count, 2, 3, 3))
    require(len(poses.clip_names) == len(poses.subjects), "subjects of other clips")
    require_indices(poses.clips, (count,), len(poses.clip_names), "clips")
    require_indices(poses.frames, (count,), 2**62, "frames")
    require_indices(poses.splits, (count,), len(SPLITS), "splits")
    require_indices(poses.donors + 1, (count, DONORS), count + 1, "donors")
    require(poses.mirrored.shape == (count,) and poses.mirrored.dtype == torch.bool, "mirrored")
    require(0 <= poses.apart <= 1e6, f"poses {poses.apart} apart")


def good_layout(folder: Path) -> Path:
    mesh = small_body().mesh
    layout = Layout(
        torch.arange(len(mesh.faces)),
        mesh.uvs,
        mesh.face_uvs,
        torch.zeros(len(mesh.faces), dtype=torch.int64),
    )
    save_layout(layout, folder / "layout.npz")
    return folder / "layout.npz"


def check_layout(layout: Layout) -> None:
    require_indices(layout.faces, (-1,), 2**62, "faces")
    require_numbers(layout.uvs, (-1, 2), "uvs")
    require_indices(layout.face_uvs, (len(layout.faces), 3), len(layout.uvs), "face_uvs")
    require_indices(layout.islands, (len(layout.faces),), 2**62, "islands")


TARGETS = [
    Target("body", good_body, load_body, check_body),
    Target("body_difference", good_difference, load_kept_body, check_body, share=0.2),
    Target("clip", good_clip, read_archive, check_clip),
    Target("amass", good_amass, read_archive, check_clip),
    Target("amass_x", good_amass_x, read_archive, check_clip),
    Target("sequence", good_sequence, load_simulated, check_sequence),
    Target("metadata", good_sequence, read_metadata, check_metadata),
    Target("packed", good_packed, read_packed, check_sequence),
    Target("poses", good_poses, lambda path: load_poses(path, small_body()), check_poses),
    Target("layout", good_layout, load_layout, check_layout),
]
