"""The shipped body, its file, and posing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from uvcloth.bodies.body import REGIONS, Body, load_body, save_body
from uvcloth.bodies.collider import ARM_PARTS, FOREARM_PARTS, LEG_PARTS, TORSO_PART, make_collider
from uvcloth.bodies.frames import HISTORY, body_frames, with_lead
from uvcloth.errors import InputError
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import neighbour_average, unique_edges
from uvcloth.geometry.skeleton import joint_transforms
from uvcloth.geometry.skinning import diffuse_weights, rotation_part, skin


def random_rotations(*shape: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    q, r = torch.linalg.qr(torch.randn(*shape, 3, 3, generator=generator))
    q = q * torch.sign(torch.diagonal(r, dim1=-2, dim2=-1))[..., None, :]
    return q * torch.linalg.det(q)[..., None, None]


def test_a_body_survives_its_file(body: Body, tmp_path: Path) -> None:
    save_body(body, tmp_path / "b.npz")
    again = load_body(tmp_path / "b.npz")
    assert (tmp_path / "b.npz").stat().st_size < 3e6
    assert again.skeleton.names == body.skeleton.names
    torch.testing.assert_close(again.mesh.vertices, body.mesh.vertices, rtol=0, atol=0)
    torch.testing.assert_close(again.weights, body.weights)
    assert torch.equal(again.regions, body.regions)
    assert again.proxies.keys() == body.proxies.keys()


def test_the_shipped_body_is_a_watertight_standing_adult(body: Body) -> None:
    mesh = trimesh.Trimesh(body.mesh.vertices.numpy(), body.mesh.faces.numpy(), process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert 0.05 < mesh.volume < 0.1
    assert 1.5 < np.ptp(mesh.vertices[:, 2]) < 2.0
    torch.testing.assert_close(body.weights.sum(1), torch.ones(len(body.weights)))
    left = body.mesh.vertices[body.mesh.faces[body.sides == 1].reshape(-1), 0]
    assert float(left.min()) > -0.02
    assert {REGIONS[int(r)] for r in body.regions.unique()} == set(REGIONS)


@pytest.mark.parametrize("damage", ["missing", "truncated", "other", "nan", "weights"])
def test_a_bad_body_file_is_named(body: Body, tmp_path: Path, damage: str) -> None:
    path = tmp_path / "b.npz"
    if damage == "truncated":
        save_body(body, path)
        path.write_bytes(path.read_bytes()[:5000])
    elif damage == "other":
        np.savez(path, format=np.array("something"))
    elif damage == "nan":
        broken = replace(body.mesh, vertices=body.mesh.vertices * float("nan"))
        save_body(replace(body, mesh=broken), path)
    elif damage == "weights":
        save_body(replace(body, weights=body.weights * float("nan")), path)
    with pytest.raises(InputError, match=r"b\.npz"):
        load_body(path)


def test_a_rigid_motion_moves_every_vertex_rigidly(body: Body) -> None:
    turn = random_rotations(1)
    rotations = turn.expand(2, len(body.skeleton.names), 3, 3)
    path = torch.tensor([[0.1, 0.2, 0.3], [1.0, -2.0, 0.5]])
    transforms = joint_transforms(body.skeleton, rotations, path)
    posed = skin(body.mesh.vertices, body.weights, transforms)
    expected = (body.mesh.vertices - body.skeleton.heads[0]) @ turn[0].T + path[:, None]
    torch.testing.assert_close(posed, expected, atol=2e-6, rtol=1e-5)
    torch.testing.assert_close(rotation_part(transforms), transforms[..., :3], atol=1e-5, rtol=0)


def test_velocity_and_acceleration_of_a_thrown_body(body: Body) -> None:
    fps, frames = 30.0, 12
    t = torch.arange(frames) / fps
    path = torch.stack([2.0 * t, torch.zeros(frames), -0.5 * 9.81 * t**2], dim=1)
    identity = torch.eye(3).expand(frames, len(body.skeleton.names), 3, 3)
    transforms = joint_transforms(body.skeleton, identity, path)
    seen = body_frames(body, transforms, fps)
    assert seen.vertices.shape[:2] == (frames - 4, HISTORY)
    torch.testing.assert_close(
        seen.velocity[..., 0], torch.full_like(seen.velocity[..., 0], 2.0), atol=1e-3, rtol=0
    )
    falling = seen.acceleration[..., 2]
    torch.testing.assert_close(falling, torch.full_like(falling, -9.81), atol=2e-2, rtol=0)
    middle = seen.vertices[3, -1] - seen.vertices[3, -2]
    torch.testing.assert_close(seen.velocity[3, -1], middle * fps)
    torch.testing.assert_close(seen.transforms[:, -1], transforms[4:])
    assert len(body_frames(body, with_lead(transforms), fps)) == frames


def test_each_part_of_the_collider_is_closed_and_together_they_are_the_body(body: Body) -> None:
    collider = make_collider(body)
    vertices = collider.vertices(body.mesh.vertices)
    parts = [trimesh.Trimesh(vertices.numpy(), faces.numpy(), process=False) for faces in collider.parts]
    for part in parts:
        assert part.is_watertight
        assert part.is_winding_consistent
        assert part.volume > 0.0
    within = [("Neck", 0), ("LeftArm", 1), ("Hips", 3), ("LeftLeg", 4), ("RightUpLeg", 5), ("LeftHand", 8)]
    for name, part in within:
        joint = body.skeleton.heads[body.skeleton.names.index(name)]
        assert parts[part].contains(joint[None].numpy())[0], name
    assert {int(vertex) for faces in collider.parts for vertex in faces.unique()} == set(range(len(vertices)))


def test_caps_bulge_out_of_what_they_close_wherever_the_body_goes(body: Body) -> None:
    collider = make_collider(body)
    count = len(body.mesh.vertices)
    tips = collider.vertices(body.mesh.vertices)[count:]
    turn, shift = random_rotations(1, seed=3)[0], torch.tensor([0.3, -1.2, 0.7])
    moved = collider.vertices(body.mesh.vertices @ turn.T + shift)[count:]
    torch.testing.assert_close(moved, tips @ turn.T + shift, atol=1e-5, rtol=0)
    knee, hip = (body.skeleton.heads[body.skeleton.names.index(name)] for name in ("LeftLeg", "LeftUpLeg"))
    thigh = collider.parts[4]
    own = tips[torch.unique(thigh[thigh >= count]) - count]
    assert len(own) == 2
    # Along the thigh, its tips lie beyond the hip and beyond the knee, within a hand's width of each.
    along = (own - hip) @ (knee - hip) / (knee - hip).norm()
    length = float((knee - hip).norm())
    assert -0.1 < float(along.min()) < 0.0
    assert length < float(along.max()) < length + 0.1


def test_cloth_touches_what_it_lies_beside_and_skirts_touch_both_legs(body: Body) -> None:
    collider = make_collider(body)
    heads = dict(zip(body.skeleton.names, body.skeleton.heads, strict=True))
    shin = 0.5 * (heads["LeftLeg"] + heads["LeftFoot"])
    between = shin * torch.tensor([0.0, 1.0, 1.0]) + torch.tensor([0.0, -0.1, 0.0])
    arm, forearm = (
        0.5 * (heads[a] + heads[b]) for a, b in (("LeftArm", "LeftForeArm"), ("LeftForeArm", "LeftHand"))
    )
    points = torch.stack([arm, heads["LeftForeArm"], forearm, heads["LeftHand"], shin, between])
    touches = collider.touches(points, body.mesh.vertices).T.tolist()
    touched = [[part for part, touched in enumerate(parts) if touched] for parts in touches]
    _, left_arm, _, _, left_thigh, right_thigh, left_calf, right_calf, left_forearm, _ = range(10)
    legs = [left_thigh, right_thigh, left_calf, right_calf]
    sleeve = [[left_arm], *[[left_arm, left_forearm]] * 3]
    assert touched == [*sleeve, [left_thigh, left_calf], legs]


@pytest.mark.parametrize("name", ["tops", "bottoms", "dress"])
def test_what_has_no_long_sleeves_meets_the_body_as_if_it_had_no_forearms(name: str, body: Body) -> None:
    long = torch.isin(body.regions, torch.tensor([REGIONS.index("forearm"), REGIONS.index("hand")]))
    without = replace(body, regions=torch.where(long, len(REGIONS), body.regions))
    cloth = fit_template(name, body).mesh.vertices
    touches, expected = (make_collider(each).touches(cloth, body.mesh.vertices) for each in (body, without))
    assert not touches[list(FOREARM_PARTS)].any()
    assert torch.equal(touches, expected)


def test_cloth_on_the_shoulder_and_under_the_arm_meets_arm_and_torso(body: Body) -> None:
    cloth = fit_template("shirt", body).mesh.vertices
    joint = body.skeleton.heads[body.skeleton.names.index("LeftArm")]
    arm, torso = make_collider(body).touches(cloth, body.mesh.vertices)[[ARM_PARTS[0], TORSO_PART]]
    out, depth, up = (cloth - joint).unbind(1)
    shoulder = (out.abs() < 0.04) & (depth.abs() < 0.04) & (up > 0.05)
    under = (out > 0.005) & (out < 0.04) & (depth.abs() < 0.04) & (up < -0.05) & (up > -0.15)
    assert shoulder.sum() > 10
    assert under.sum() > 10
    assert (arm & torso)[shoulder].all()
    assert (arm & torso)[under].float().mean() > 0.9


def test_cloth_on_a_body_without_arms_meets_its_torso(body: Body) -> None:
    arm = body.regions == REGIONS.index("upper_arm")
    armless = replace(body, regions=torch.where(arm, len(REGIONS), body.regions))
    touches = make_collider(armless).touches(fit_template("tops", body).mesh.vertices, body.mesh.vertices)
    assert not touches[list(ARM_PARTS)].any()
    assert touches[TORSO_PART].float().mean() > 0.9


def test_all_of_a_narrow_skirt_touches_legs_and_torso_and_trousers_what_they_lie_on(body: Body) -> None:
    """A tube 2 cm off both thighs, from 8 to 28 cm below the crotch."""
    torso, thigh = (body.mesh.faces[body.regions == REGIONS.index(name)] for name in ("torso", "thigh"))
    middle = body.mesh.vertices[torso, 2].min() - 0.18
    thighs = body.mesh.vertices[thigh].reshape(-1, 3)
    low, high = thighs[(thighs[:, 2] - middle).abs() < 0.1, :2].aminmax(dim=0)
    tube = trimesh.creation.cylinder(1.0, 0.2, sections=64).subdivide()
    around = torch.tensor(tube.faces[abs(tube.face_normals[:, 2]) < 0.5]).long()
    size = torch.cat([(high - low) / 2 + 0.02, torch.ones(1)])
    skirt = torch.tensor(tube.vertices).float() * size + torch.cat([(high + low) / 2, middle[None]])
    trousers, collider = fit_template("bottoms", body).mesh, make_collider(body)
    for points, faces in ((skirt, around), (trousers.vertices, trousers.faces)):
        beside, legs = (
            collider.touches(points, body.mesh.vertices, by)[[TORSO_PART, *LEG_PARTS]][:, faces.unique()]
            for by in (None, faces)
        )
        assert beside.all(0).float().mean() < 0.9
        assert legs.all() if faces is around else torch.equal(legs, beside)


def test_a_wide_sleeve_is_no_skirt_and_a_wide_skirt_no_sleeve(body: Body) -> None:
    heads = dict(zip(body.skeleton.names, body.skeleton.heads, strict=True))
    sleeve = 0.5 * (heads["RightForeArm"] + heads["RightHand"]) - torch.tensor([0.0, 0.0, 0.1])
    skirt = heads["RightFingerBase"] + torch.tensor([0.2, 0.0, 0.0])
    touches = make_collider(body).touches(torch.stack([sleeve, skirt]), body.mesh.vertices)
    assert touches[:, 0].nonzero().flatten().tolist() == [ARM_PARTS[1], FOREARM_PARTS[1]]
    assert touches[list(LEG_PARTS), 1].all()
    assert not touches[list(FOREARM_PARTS), 1].any()


def test_diffused_weights_blend_and_still_sum_to_one() -> None:
    sheet = trimesh.creation.icosphere(3)
    vertices = torch.from_numpy(sheet.vertices).float()
    weights = torch.stack([vertices[:, 0] > 0, vertices[:, 0] <= 0], dim=1).float()
    spread = diffuse_weights(weights, vertices, torch.from_numpy(sheet.faces), 0.4)
    torch.testing.assert_close(spread.sum(1), torch.ones(len(vertices)))
    edge = vertices[:, 0].abs() < 0.1
    assert float((spread[edge, 0] - 0.5).abs().mean()) < float((weights[edge, 0] - 0.5).abs().mean()) / 2
    assert float(spread[vertices[:, 0] > 0.9, 0].min()) > 0.99


@pytest.mark.parametrize("passes", [1, 2, 7, 60, 900])
def test_diffusion_is_that_many_passes_of_averaging(passes: int) -> None:
    sheet = trimesh.creation.icosphere(3)
    vertices, faces = torch.from_numpy(sheet.vertices).float(), torch.from_numpy(sheet.faces)
    weights = torch.rand((len(vertices), 3), generator=torch.Generator().manual_seed(0))
    weights = weights / weights.sum(1, keepdim=True)
    edges = unique_edges(faces)
    length = float((vertices[edges[:, 0]] - vertices[edges[:, 1]]).norm(dim=1).mean())
    average, repeated = neighbour_average(faces, len(vertices)).double(), weights.double()
    for _ in range(passes):
        repeated = 0.5 * repeated + 0.5 * torch.sparse.mm(average, repeated)
    spread = diffuse_weights(weights, vertices, faces, length * passes**0.5)
    repeated = repeated / repeated.sum(1, keepdim=True)
    torch.testing.assert_close(spread, repeated.float(), atol=2e-6, rtol=0.0)
