"""PBNS without training: what it sees of a pose, what it keeps of blend weights, and whom it dresses."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from tests.methods.stepping import predicted
from tests.small_body import small_body
from tests.train.simulated import swaying
from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import body_frames, with_lead
from uvcloth.checkpoint import CONFIG, WEIGHTS, TrainingData, load_tensors, save_checkpoint, save_tensors
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skeleton import Skeleton, joint_transforms
from uvcloth.geometry.skinning import skin
from uvcloth.methods.pbns.method import PBNS, new_network, pbns_checkpoint, rest_outfit
from uvcloth.methods.pbns.network import PBNSConfig, PBNSNetwork
from uvcloth.methods.registry import load_method
from uvcloth.methods.rig import pose_vectors
from uvcloth.rollouts.rollout import rollout

CONFIG_HERE = PBNSConfig(width=8, layers=2)


def turn(axis: tuple[float, float, float], angle: float) -> Tensor:
    """The rotation by an angle about an axis: (3, 3)."""
    x, y, z = (angle * torch.nn.functional.normalize(torch.tensor(axis).float(), dim=0)).tolist()
    return torch.matrix_exp(torch.tensor([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]))


def sheet(name: str = "shirt", height: float = 0.12) -> Garment:
    """A strip of four triangles over the cube; its middle edge is a texture seam, with doubled vertices.

    Vertices 2 and 4 are at one place, as are 3 and 5; each half hangs on both joints, on one the more.
    """
    x, y = torch.tensor([-0.1, -0.1, 0.0, 0.0, 0.0, 0.0, 0.1, 0.1]), 0.1 * torch.tensor([-1.0, 1.0] * 4)
    vertices = torch.stack([x, y, torch.full_like(x, height)], dim=1)
    faces = torch.tensor([[0, 2, 3], [0, 3, 1], [4, 6, 7], [4, 7, 5]])
    weights = torch.tensor([[0.2, 0.8]] * 4 + [[0.7, 0.3]] * 4)
    return Garment(name, "tops", Mesh(vertices, faces, vertices[:, :2] + 0.5, faces), weights, weights)


def outfit_of(*names: str, body: Body | None = None) -> Outfit:
    garments = [sheet(name, 0.12 + 0.01 * index) for index, name in enumerate(names)]
    return Outfit(body or small_body(), tuple(garments))


def untrained(outfit: Outfit, config: PBNSConfig = CONFIG_HERE) -> PBNS:
    """With random blend shapes of some centimetres."""
    torch.manual_seed(0)
    worn = rest_outfit(outfit)
    weights = torch.cat([garment.weights for garment in outfit.garments])
    network = new_network(config, worn, weights, torch.rand(5, 3 * len(worn.heads)))
    with torch.no_grad():
        network.shapes.mul_(100.0)
    return PBNS(config, network.eval(), worn)


def some_motion(body: Body, frames: int = 4) -> Tensor:
    """Both joints of the small body turn, and it walks off: (frames, 2, 3, 4)."""
    turns = [torch.stack([turn((1, 2, 0), 0.2 * k), turn((0, 1, 1), 0.5 * k)]) for k in range(frames)]
    path = torch.stack([torch.arange(float(frames)), *[torch.zeros(frames)] * 2], dim=1)
    return joint_transforms(body.skeleton, torch.stack(turns), path)


def test_at_rest_no_joint_turns_and_gravity_points_down(body: Body) -> None:
    joints = len(body.skeleton.names)
    rest = torch.eye(3, 4).expand(2, joints, 3, 4)
    expected = torch.zeros(2, joints, 3)
    expected[:, 0] = torch.tensor([0.0, 0.0, -1.0])
    torch.testing.assert_close(pose_vectors(body.skeleton.parents, rest), expected.flatten(1))


def test_heading_and_place_are_not_part_of_the_pose(body: Body) -> None:
    transforms = swaying(4, seed=1).transforms()
    moved = turn((0, 0, 1), 2.5) @ transforms
    moved[..., 3] += torch.tensor([4.0, -3.0, 1.0])
    parents = body.skeleton.parents
    seen = pose_vectors(parents, transforms)
    torch.testing.assert_close(pose_vectors(parents, moved), seen, atol=1e-5, rtol=0)
    assert seen.std(0).max() > 0.1


def test_a_tilt_of_the_root_is_seen_and_nothing_else_of_it(body: Body) -> None:
    transforms = swaying(2, seed=1).transforms()
    parents = body.skeleton.parents
    tilted, before = (pose_vectors(parents, x) for x in (turn((1, 0, 0), 0.3) @ transforms, transforms))
    torch.testing.assert_close(tilted[:, 3:], before[:, 3:], atol=1e-5, rtol=0)
    assert (tilted[:, :3] - before[:, :3]).norm(dim=1).min() > 0.2
    leaning = turn((1, 0, 0), 0.3) @ torch.eye(3, 4).expand(1, len(parents), 3, 4)
    expected = torch.tensor([0.0, -math.sin(0.3), -math.cos(0.3)])
    torch.testing.assert_close(pose_vectors(parents, leaning)[0, :3], expected)


@pytest.mark.parametrize("name", ["LeftArm", "Spine", "RightLeg"])
def test_a_turned_joint_is_seen_as_its_axis_and_angle(name: str, body: Body) -> None:
    """Everything below the joint turns along, and none of that is a turn of its own."""
    skeleton = body.skeleton
    joint = skeleton.names.index(name)
    below = {joint}
    for child, parent in enumerate(skeleton.parents):
        below |= {child} if parent in below else set()
    whole = turn((0.3, 1, 0.2), 0.8)
    local = turn((1, -2, 0.5), 1.1)
    rotations = whole.expand(1, len(skeleton.names), 3, 3).clone()
    rotations[:, sorted(below)] = whole @ local
    seen = pose_vectors(skeleton.parents, joint_transforms(skeleton, rotations, torch.zeros(1, 3)))
    axis = torch.tensor([1.0, -2.0, 0.5])
    vectors = seen.view(-1, 3)
    torch.testing.assert_close(vectors[joint], 1.1 * axis / axis.norm(), atol=1e-5, rtol=0)
    others = [k for k in range(1, len(skeleton.names)) if k != joint]
    assert vectors[others].abs().max() < 1e-5


def test_a_new_network_keeps_the_four_strongest_weights() -> None:
    """Weights from a hundredth to nearly one come back as they were, but for rounding."""
    shares = torch.tensor(
        [
            [0.3, 0.05, 0.25, 0.15, 0.05, 0.2],
            [0.96, 0.01, 0.01, 0.02, 0.0, 0.0],
            [0.1, 0.2, 0.3, 0.4, 0.0, 0.0],
            [1 / 6] * 6,
        ]
    )
    points = torch.rand(4, 3, generator=torch.Generator().manual_seed(0))
    mesh = Mesh(points, torch.tensor([[0, 1, 2], [0, 2, 3]]), points[:, :2], torch.zeros(2, 3).long())
    worn = replace(rest_outfit(outfit_of("shirt")), meshes=(mesh,), heads=torch.rand(6, 3))
    network = new_network(PBNSConfig(width=2, layers=1), worn, shares, torch.zeros(1, 18))
    kept, places = shares.topk(4, dim=1)
    expected = torch.zeros(4, 6).scatter(1, places, kept / kept.sum(1, keepdim=True))
    torch.testing.assert_close(network.blend_weights(), expected, atol=2e-4, rtol=0)
    assert ((network.blend_weights() > 0).sum(1) <= 4).all()
    torch.testing.assert_close(network.blend_weights().sum(1), torch.ones(4))
    everything = new_network(PBNSConfig(width=2, layers=1, influences=99), worn, shares, torch.zeros(1, 18))
    torch.testing.assert_close(everything.blend_weights(), shares, atol=4e-4, rtol=0)


def test_blend_weights_stay_shares_however_they_are_trained() -> None:
    network = untrained(outfit_of("shirt")).network
    with torch.no_grad():
        network.sharp_weights.add_(torch.randn_like(network.sharp_weights))
    weights = network.blend_weights()
    assert (weights >= 0).all()
    torch.testing.assert_close(weights.sum(1), torch.ones(len(weights)))
    assert weights.std() > 0.1


def test_vertices_at_a_texture_seam_move_as_one() -> None:
    outfit = outfit_of("shirt", "coat")
    method = untrained(outfit)
    assert method.network.shapes.shape == (8, 3 * 12)
    assert torch.equal(method.network.owner, torch.tensor([0, 1, 2, 3, 2, 3, 4, 5, 6, 7, 8, 9, 8, 9, 10, 11]))
    frames = body_frames(outfit.body, with_lead(some_motion(outfit.body)), 30.0)
    posed = predicted(method, outfit, frames)
    for vertices, garment in zip(posed, outfit.garments, strict=True):
        assert torch.equal(vertices[:, [2, 3]], vertices[:, [4, 5]])
        still = skin(garment.mesh.vertices, garment.weights, frames.transforms[:, -1])
        assert (still[1:, [2, 3]] - still[1:, [4, 5]]).norm(dim=2).min() > 1e-3


def test_a_step_is_the_skinned_sum_of_rest_and_blend_shapes() -> None:
    """Paper eq. 1 and 2, vertex by vertex."""
    outfit = outfit_of("shirt")
    method = untrained(outfit)
    frames = body_frames(outfit.body, with_lead(some_motion(outfit.body)), 30.0)
    (posed,) = predicted(method, outfit, frames)
    transforms, network = frames.transforms[:, -1], method.network
    with torch.no_grad():
        embedded = network.embed(pose_vectors((-1, 0), transforms))
        shapes = network.shapes.view(len(network.shapes), -1, 3)[:, network.owner]
        weights = network.blend_weights()
    assert (embedded >= 0).all()
    for frame, (share, joints) in enumerate(zip(embedded, transforms, strict=True)):
        deformed = outfit.garments[0].mesh.vertices + (share[:, None, None] * shapes).sum(0)
        blended = (weights[:, :, None, None] * joints).sum(1)
        expected = (blended[:, :, :3] @ deformed[:, :, None]).squeeze(2) + blended[:, :, 3]
        torch.testing.assert_close(posed[frame], expected, atol=1e-5, rtol=1e-5)


def test_without_shapes_the_rest_pose_gives_the_rest_garment_and_a_rigid_motion_carries_it() -> None:
    outfit = outfit_of("shirt", "coat")
    method = untrained(outfit)
    with torch.no_grad():
        method.network.shapes.zero_()
    rest = torch.eye(3, 4).expand(1, 2, 3, 4)
    rigid = torch.cat([turn((1, 1, 0), 0.7), torch.tensor([[1.0], [2.0], [3.0]])], dim=1)
    for motion in (rest, rigid.expand(1, 2, 3, 4)):
        frames = body_frames(outfit.body, with_lead(motion), 30.0)
        posed = predicted(method, outfit, frames)
        for vertices, garment in zip(posed, outfit.garments, strict=True):
            expected = garment.mesh.vertices @ motion[0, 0, :, :3].T + motion[0, 0, :, 3]
            torch.testing.assert_close(vertices[0], expected, atol=1e-6, rtol=1e-6)


def with_mesh(outfit: Outfit, **changed: Tensor) -> Outfit:
    garment = outfit.garments[0]
    return replace(outfit, garments=(replace(garment, mesh=replace(garment.mesh, **changed)),))


def with_heads(*heads: tuple[float, float, float]) -> Body:
    """The small body with other joints."""
    body = small_body()
    names = (*body.skeleton.names, "hand")[: len(heads)]
    return replace(body, skeleton=Skeleton(names, (-1, 0, 1)[: len(heads)], torch.tensor(heads)))


TALL = with_heads((0.0, 0.0, -0.1), (0.0, 0.0, 0.003))
HANDED = with_heads((0.0, 0.0, -0.1), (0.0, 0.0, 0.0), (0.0, 0.0, 0.1))
SHIRT = outfit_of("shirt")
MESH = SHIRT.garments[0].mesh


@pytest.mark.parametrize(
    ("outfit", "words"),
    [
        (outfit_of("coat"), "model pbns is for shirt, not for coat"),
        (outfit_of("shirt", "coat"), "model pbns is for shirt, not for coat over shirt"),
        (outfit_of("shirt", body=TALL), "model pbns was trained on another body than 'box'"),
        (outfit_of("shirt", body=HANDED), "model pbns was trained on another body than 'box'"),
        (with_mesh(SHIRT, faces=MESH.faces.flip(1)), "shirt: model pbns is for shirt, but another mesh"),
        (with_mesh(SHIRT, faces=MESH.faces[:3]), "shirt: model pbns is for shirt, but another mesh"),
        (
            with_mesh(SHIRT, vertices=torch.cat([MESH.vertices, torch.zeros(1, 3)])),
            "shirt: model pbns is for shirt, but another mesh",
        ),
        (with_mesh(SHIRT, vertices=MESH.vertices + 0.003), "shirt: model pbns is for shirt, 5 mm from it"),
    ],
    ids=[
        "garment",
        "outfit",
        "taller body",
        "other skeleton",
        "faces",
        "fewer faces",
        "one more vertex",
        "shape",
    ],
)
def test_what_it_was_not_trained_for_is_refused(outfit: Outfit, words: str) -> None:
    method = untrained(SHIRT)
    assert method.unsupported_reason(SHIRT) == ""
    assert method.unsupported_reason(with_mesh(SHIRT, vertices=MESH.vertices + 0.001)) == ""
    assert words in method.unsupported_reason(outfit)
    with pytest.raises(InputError, match=words):
        method.prepare(outfit, torch.device("cpu"))


def test_another_order_is_refused() -> None:
    both = outfit_of("shirt", "coat")
    method = untrained(both)
    assert method.unsupported_reason(both) == ""
    turned = replace(both, garments=both.garments[::-1])
    assert method.unsupported_reason(turned) == "model pbns is for coat over shirt, not for shirt over coat"
    assert "is for no garment yet" in PBNS.untrained(PBNSConfig()).unsupported_reason(both)


@pytest.mark.parametrize("index", [0, 1])
def test_a_part_of_the_outfit_moves_as_in_it(index: int) -> None:
    both = outfit_of("shirt", "coat")
    part = replace(both, garments=both.garments[index : index + 1])
    method = untrained(both)
    frames = body_frames(both.body, with_lead(some_motion(both.body)), 30.0)
    together, alone = (predicted(method, worn, frames) for worn in (both, part))
    assert len(alone) == 1
    assert torch.equal(alone[0], together[index])


def saved(folder: Path, outfit: Outfit) -> PBNS:
    method = untrained(outfit)
    save_checkpoint(
        pbns_checkpoint(method, outfit.body, TrainingData({"poses.npz": "abc"}), {"step": 1}), folder
    )
    return method


def test_a_saved_model_dresses_as_before(tmp_path: Path) -> None:
    outfit = outfit_of("shirt", "coat")
    method = saved(tmp_path / "mine", outfit)
    loaded = load_method(tmp_path / "mine", outfit.body)
    assert isinstance(loaded, PBNS)
    assert loaded.name == "mine"
    assert loaded.config == method.config
    assert loaded.garments.names == ("shirt", "coat")
    motion = some_motion(outfit.body)
    before, after = (list(rollout(m, outfit, motion, 30.0, clear=False)) for m in (method, loaded))
    for one, other in zip(before, after, strict=True):
        for vertices, again in zip(one.raw, other.raw, strict=True):
            # Half precision costs 1/2048 of blend shapes that are decimetres here.
            torch.testing.assert_close(vertices, again, atol=2e-4, rtol=0)
    assert (before[1].raw[0] - before[0].raw[0]).abs().max() > 0.01


def test_shapes_that_no_training_pose_has_are_not_saved() -> None:
    network = PBNSNetwork(PBNSConfig(width=8, layers=2), vertices=5, unique=5, joints=2, poses=4)
    network.poses = torch.randn(4, 6)
    with torch.no_grad():
        network.layers[1].bias.copy_(torch.tensor([9.0, -9.0] * 4))
    state = network.used()
    smaller = PBNSNetwork(PBNSConfig(width=8, layers=2), 5, 5, 2, 4, shapes=len(state["shapes"]))
    smaller.load_state_dict(state)
    assert len(smaller.shapes) == 4
    torch.testing.assert_close(smaller.deform(network.poses), network.deform(network.poses))


def other_config(**changed: object) -> Callable[[Path], None]:
    def damage(folder: Path) -> None:
        meta = json.loads((folder / CONFIG).read_text())
        meta["config"] |= changed
        (folder / CONFIG).write_text(json.dumps(meta))

    return damage


def other_tensor(name: str, change: Callable[[Tensor], Tensor | None]) -> Callable[[Path], None]:
    def damage(folder: Path) -> None:
        tensors, _ = load_tensors(folder / WEIGHTS)
        changed = change(tensors.pop(name))
        save_tensors(tensors | ({} if changed is None else {name: changed}), {}, folder / WEIGHTS)

    return damage


def truncated(folder: Path) -> None:
    (folder / WEIGHTS).write_bytes((folder / WEIGHTS).read_bytes()[:500])


def without_config(folder: Path) -> None:
    meta = json.loads((folder / CONFIG).read_text())
    del meta["config"]["influences"]
    (folder / CONFIG).write_text(json.dumps(meta))


@pytest.mark.parametrize(
    "damage",
    [
        truncated,
        without_config,
        other_config(width=9),
        other_config(width=0),
        other_config(layers=3),
        other_config(influences=1),
        other_config(width="wide"),
        other_config(depth=3),
        other_tensor("network.owner", lambda owner: None),
        other_tensor("network.owner", lambda owner: owner + 5),
        other_tensor("network.strongest", lambda strongest: strongest + 1),
        other_tensor("network.rest", lambda rest: rest * math.nan),
        other_tensor("network.rest", lambda rest: rest[:-1]),
        other_tensor("network.poses", lambda poses: poses[:, :3]),
        other_tensor("mesh.0.vertices", lambda vertices: vertices[:-1]),
        other_tensor("mesh.0.faces", lambda faces: None),
        other_tensor("heads", lambda heads: heads[:1]),
        other_tensor("parents", lambda parents: parents[:1]),
        other_tensor("parents", lambda parents: parents + 5),
    ],
)
def test_a_damaged_model_is_refused_by_its_folder(damage: Callable[[Path], None], tmp_path: Path) -> None:
    saved(tmp_path / "mine", SHIRT)
    damage(tmp_path / "mine")
    with pytest.raises(InputError, match="mine"):
        load_method(tmp_path / "mine", SHIRT.body)


def test_a_model_of_another_topology_is_refused(tmp_path: Path) -> None:
    saved(tmp_path / "mine", SHIRT)
    with pytest.raises(InputError, match="mine: the model was trained on the mesh and rig of body 'box'"):
        load_method(tmp_path / "mine", small_body(flipped=True))


@pytest.mark.parametrize("name", ["width", "layers", "influences"])
def test_sizes_that_are_none_are_refused(name: str) -> None:
    with pytest.raises(InputError, match=f"--{name} 0: has to be from 1 to"):
        PBNSConfig(**{name: 0})
