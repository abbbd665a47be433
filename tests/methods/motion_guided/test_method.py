from dataclasses import replace

import pytest
import torch

from tests.train.simulated import swaying
from uvcloth.bodies.body import load_body
from uvcloth.checkpoint import WEIGHTS, TrainingData, save_checkpoint
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import Mesh, edge_lengths, unique_edges, vertex_normals
from uvcloth.geometry.skinning import apply_transforms, skin
from uvcloth.methods.ensemble import Ensemble
from uvcloth.methods.lbs import LBSConfig, create_lbs
from uvcloth.methods.motion_guided.config import PRESETS, MotionGuidedConfig
from uvcloth.methods.motion_guided.dynamics_input import Pose, local_offsets, posed_shape, rest_shape
from uvcloth.methods.motion_guided.garment_maps import local_axes
from uvcloth.methods.motion_guided.latent import DISPLACEMENT_SCALE
from uvcloth.methods.motion_guided.method import Both, MotionGuided, motion_guided_checkpoint
from uvcloth.methods.motion_guided.seeds import (
    PARTS,
    kernel_transforms,
    nearest_kernels,
    pose_seeds,
    sample_seeds,
)
from uvcloth.methods.registry import SHIPPED, load_method
from uvcloth.motion.library import load_clip
from uvcloth.rollouts.rollout import rollout

TINY = PRESETS["tiny"]


@pytest.fixture(scope="module")
def body():
    return load_body()


@pytest.fixture(scope="module")
def dress(body):
    return fit_template("dress", body)


@pytest.fixture(scope="module")
def maps(body, dress):
    return TINY.maps(dress, body)


def test_seeds_cover_every_part_of_the_body(body):
    seeds = sample_seeds(body, 581)
    assert seeds.points.shape == (581, 3)
    assert set(seeds.parts.tolist()) == set(range(len(PARTS)))
    gaps = torch.cdist(seeds.points, seeds.points).fill_diagonal_(1.0).amin(1)
    assert gaps.min() > 0.005
    assert gaps.max() < 0.12


def test_kernel_skinning_follows_its_equation(body, maps):
    transforms = swaying(5, seed=0).transforms()
    posed = pose_seeds(maps.seeds, transforms)
    radii = torch.linspace(0.04, 0.08, len(PARTS))
    points = maps.points[::400].expand(5, -1, -1)
    kernels = nearest_kernels(maps.points[::400], maps.seeds, TINY.near)
    got = apply_transforms(kernel_transforms(points, kernels, radii, maps.seeds, posed), points)
    for frame in (0, 3):
        for vertex in range(points.shape[1]):
            chosen = kernels.seeds[vertex]
            radius = radii[maps.seeds.parts[chosen]]
            apart = (points[frame, vertex] - maps.seeds.points[chosen]).norm(dim=1)
            shares = torch.exp(-(apart**2) / (2 * radius**2))
            moved = posed.points[frame, chosen] + (
                posed.rotations[frame, chosen]
                @ (points[frame, vertex] - maps.seeds.points[chosen])[..., None]
            ).squeeze(-1)
            expected = (shares[:, None] * moved).sum(0) / shares.sum()
            torch.testing.assert_close(got[frame, vertex], expected, atol=1e-5, rtol=0)


def test_a_rigid_motion_carries_the_garment_exactly(body, maps):
    turn = torch.linalg.matrix_exp(torch.tensor([[0.0, -0.4, 0.1], [0.4, 0.0, 0.2], [-0.1, -0.2, 0.0]]))
    rigid = torch.cat([turn, torch.tensor([[1.0], [2.0], [3.0]])], dim=1)
    transforms = rigid.expand(1, len(body.skeleton.names), 3, 4)
    radii = torch.full((len(PARTS),), 0.05)
    posed = pose_seeds(maps.seeds, transforms)
    blended = kernel_transforms(maps.points[None], maps.kernels, radii, maps.seeds, posed)
    moved = apply_transforms(blended, maps.points)
    torch.testing.assert_close(moved[0], maps.points @ turn.T + rigid[:, 3], atol=1e-5, rtol=0)


def test_offsets_from_the_carrier_do_not_change_with_a_rigid_motion(body, maps):
    still = swaying(1, seed=0).transforms()
    turn = torch.linalg.matrix_exp(torch.tensor([[0.0, -0.4, 0.1], [0.4, 0.0, 0.2], [-0.1, -0.2, 0.0]]))
    turned = turn @ still
    turned[..., 3] += torch.tensor([1.0, 2.0, 3.0])
    garment = maps.texel_points[None] + 0.02
    moved = garment @ turn.T + torch.tensor([1.0, 2.0, 3.0])
    torch.testing.assert_close(
        local_offsets(maps, moved, turned), local_offsets(maps, garment, still), atol=1e-5, rtol=0
    )


def test_local_axes_are_orthonormal_and_right_handed(dress):
    axes = local_axes(dress.mesh)
    torch.testing.assert_close(axes.transpose(1, 2) @ axes, torch.eye(3).expand_as(axes), atol=1e-5, rtol=0)
    assert (torch.linalg.det(axes) > 0.99).all()


def test_seams_hold(dress, maps):
    """A vertex that the layout cuts has one displacement, and its neighbours on either side are near it."""
    torch.manual_seed(0)
    space = replace(TINY, size=32, linear=False).shape_space()
    fine = replace(TINY, size=32).maps(dress, load_body())
    shape = rest_shape(space, fine, torch.randn(1, TINY.latent))[0]
    faces = dress.mesh.faces
    stretched = (shape[faces[:, 0]] - shape[faces[:, 1]]).norm(dim=1)
    rest = (fine.points[faces[:, 0]] - fine.points[faces[:, 1]]).norm(dim=1)
    assert (stretched / rest).max() < 4.0


def test_a_garment_without_texture_coordinates_is_unwrapped(body, dress):
    mesh = Mesh(
        dress.mesh.vertices, dress.mesh.faces, torch.zeros(0, 2), torch.zeros(0, 3, dtype=torch.int64)
    )
    bare = TINY.maps(replace(dress, mesh=mesh), body)
    assert bare.mask.mean() > 0.2


def checkpoint_of(method, folder, body, tensors=None):
    tensors = Both(method).state_dict() if tensors is None else tensors
    save_checkpoint(motion_guided_checkpoint(method.config, tensors, body, TrainingData(), {}), folder)


def test_a_saved_model_rolls_out_as_before(body, dress, tmp_path):
    torch.manual_seed(1)
    method = MotionGuided.untrained(TINY)
    both = Both(method)
    both.half().float()  # as it is saved
    checkpoint_of(method, tmp_path / "run", body)
    outfit, motion = Outfit(body, (dress,)), swaying(6, seed=1).transforms()
    loaded = load_method(tmp_path / "run", body)
    before, after = (
        [frame.raw[0] for frame in rollout(m, outfit, motion, 30.0, clear=False)] for m in (method, loaded)
    )
    assert len(before) == 6
    for one, other in zip(before, after, strict=True):
        torch.testing.assert_close(one, other)


def test_the_first_stage_alone_is_no_model(body, tmp_path):
    method = MotionGuided.untrained(TINY)
    tensors = {n: t for n, t in Both(method).state_dict().items() if n.startswith("space.")}
    checkpoint_of(method, tmp_path / "shape", body, tensors)
    with pytest.raises(InputError, match="only the first stage"):
        load_method(tmp_path / "shape", body)


def test_another_garment_is_refused(body):
    outfit = Outfit(body, (fit_template("tops", body),))
    with pytest.raises(InputError, match="garment tops: model motion_guided is for the garment dress"):
        next(iter(rollout(MotionGuided.untrained(TINY), outfit, swaying(2, seed=0).transforms(), 30.0)))


def test_it_says_what_it_is_for(body, dress):
    tops, layered = fit_template("tops", body), MotionGuided.untrained(replace(TINY, under="tops"))
    assert MotionGuided.untrained(TINY).unsupported_reason(Outfit(body, (dress,))) == ""
    assert "over tops, here it is over nothing" in layered.unsupported_reason(Outfit(body, (dress,)))
    assert layered.unsupported_reason(Outfit(body, (dress,), under=tops)) == ""
    other = replace(MotionGuided.untrained(TINY), topology="another")
    assert "another mesh of that name" in other.unsupported_reason(Outfit(body, (dress,)))
    both = Outfit(body, (tops, dress))
    assert Ensemble.of((create_lbs(LBSConfig()), layered)).unsupported_reason(both) == ""
    assert "over nothing" in Ensemble.of((layered, create_lbs(LBSConfig()))).unsupported_reason(
        Outfit(body, (dress, tops))
    )
    assert "models given: 1, garments: 2" in Ensemble.of((layered,)).unsupported_reason(both)


def test_maps_that_cannot_be_halved_are_refused():
    with pytest.raises(InputError, match="power of two"):
        MotionGuidedConfig(size=48)


def test_codes_decode_to_displacements_in_the_local_frames_at_rest(body, dress):
    """A linear space whose two codes raise every vertex along its normal, and move one vertex aside."""
    space = TINY.shape_space()
    count = len(dress.mesh.vertices)
    for parameter in space.decoder.parameters():
        torch.nn.init.zeros_(parameter)
    with torch.no_grad():
        space.decoder.weight.view(count, 3, -1)[:, 2, 0] = 0.01 / DISPLACEMENT_SCALE
        space.decoder.weight.view(count, 3, -1)[7, 0, 1] = 0.02 / DISPLACEMENT_SCALE
    method = replace(MotionGuided.untrained(TINY), space=space)
    decoded = method.garment_space(dress, body)
    assert decoded.size == TINY.latent
    codes = torch.zeros(3, TINY.latent)
    codes[1, 0], codes[2, 1] = 2.0, -1.0
    rest, raised, aside = decoded.decode(codes)
    torch.testing.assert_close(rest, dress.mesh.vertices)
    normals = vertex_normals(dress.mesh.vertices, dress.mesh.faces)
    torch.testing.assert_close(raised - rest, 0.02 * normals, atol=1e-5, rtol=0)
    moved = aside - rest
    assert moved[7].norm().item() == pytest.approx(0.02, rel=1e-4)
    assert (moved[7] @ normals[7]).abs() < 1e-6
    assert moved.norm(dim=1).count_nonzero() == 1


def test_shapes_are_posed_as_their_vertices_are_skinned(dress, maps):
    """Displaced at rest, a garment moves with its own smooth weights: skin it by hand."""
    transforms = swaying(2, seed=0).transforms()
    resting = dress.mesh.vertices + 0.02 * torch.sin(5.0 * dress.mesh.vertices)
    pose = Pose(transforms, pose_seeds(maps.seeds, transforms))
    posed = posed_shape(TINY.shape_space(), maps, resting.expand(2, -1, -1), pose)
    torch.testing.assert_close(posed, skin(resting, dress.smooth_weights, transforms), atol=1e-5, rtol=0)


def test_the_model_that_ships_swings_on_when_the_body_stops(body, dress):
    """Inertia, of which a skinned dress has none: the hem starts late, goes on and comes to rest."""
    assert (SHIPPED / "motion_guided" / WEIGHTS).stat().st_size < 5e6
    walk = load_clip("walk", body).transforms()[40:46]
    motion = torch.cat([walk, walk[-1:].expand(8, -1, -1, -1)])
    model = load_method("motion_guided", body)
    frames = torch.stack(
        [f.raw[0] for f in rollout(model, Outfit(body, (dress,)), motion, 30.0, clear=False)]
    )
    carried = skin(dress.mesh.vertices, dress.smooth_weights, motion)
    height = dress.mesh.vertices[:, 2]
    hem, chest = height < height.quantile(0.2), height > height.quantile(0.8)

    def moved(vertices, part):
        """Millimetres from each frame to the next, mean over a part of the dress."""
        return 1000.0 * (vertices[1:] - vertices[:-1])[:, part].norm(dim=2).mean(1)

    assert moved(frames, hem)[0] < 0.75 * moved(carried, hem)[0]
    assert moved(frames, chest)[0] > 0.9 * moved(carried, chest)[0]
    swing = moved(frames, hem)[5:]
    assert swing[0] > 10.0
    assert swing.sum() > 3.0 * moved(frames, chest)[5:].sum()
    assert swing[-1] < 0.2 * swing[0]
    edges = unique_edges(dress.mesh.faces)
    lengths = edge_lengths(dress.mesh.vertices, edges)
    stretched = edge_lengths(frames, edges) / lengths
    assert 0.95 < stretched.median() < 1.05
    # The longest edge is in the armpit, where the skinned dress has its longest as well.
    assert stretched.max() < 1.05 * (edge_lengths(carried, edges) / lengths).max()
