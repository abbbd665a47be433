from dataclasses import replace

import pytest
import torch

from tests.methods.stepping import predicted
from tests.train.simulated import swaying
from train.physxnet.prepare import make
from uvcloth.bodies.body import load_body
from uvcloth.bodies.frames import body_frames, with_lead
from uvcloth.checkpoint import TrainingData, load_checkpoint, save_checkpoint
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.rotations import rotate
from uvcloth.geometry.skinning import skin, skin_frames
from uvcloth.geometry.units import FREE_FALL
from uvcloth.methods.physxnet.config import PRESETS
from uvcloth.methods.physxnet.maps import garment_vertices, motion_values, template_offsets
from uvcloth.methods.physxnet.method import PhysXNet, load_physxnet, physxnet_checkpoint
from uvcloth.methods.physxnet.network import GarmentNet, mirror
from uvcloth.methods.registry import load_method
from uvcloth.rollouts.rollout import rollout

TEMPLATES = ("tops", "dress")
TINY = replace(PRESETS["tiny"], templates=TEMPLATES)


@pytest.fixture(scope="module")
def body():
    return load_body()


@pytest.fixture(scope="module")
def prepared(body):
    return make(body, TEMPLATES, 64)


@pytest.fixture(scope="module")
def outfit(body):
    return Outfit(body, tuple(fit_template(name, body) for name in TEMPLATES))


def test_the_paper_s_network_has_the_published_shapes():
    """Three frames of velocity and acceleration, 256 x 256, through 64 to 512 channels to three offset maps.

    Every strided convolution halves the map (section 3.2, figure 2). Nothing is computed: no device holds
    the values.
    """
    with torch.device("meta"):
        net = GarmentNet(PRESETS["paper"])
        maps = torch.empty(1, 18, 256, 256)
    seen = []
    for layer in net.unet.encoder:
        layer.register_forward_hook(lambda _, given, made: seen.append(tuple(made.shape[1:])))
    assert net(maps).shape == (1, 9, 256, 256)
    assert seen == [(64, 128, 128), (128, 64, 64), (256, 32, 32), (512, 16, 16)]
    assert len(net.unet.decoders) == 3
    assert not any(isinstance(each, torch.nn.Upsample) for each in net.modules())


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("history", [0, 2])
def test_every_channel_that_goes_in_changes_the_maps_that_come_out(preset, history):
    torch.manual_seed(0)
    config = replace(PRESETS[preset], size=32, width=8, history=history)
    method = PhysXNet.untrained(config)
    assert method.traits.autoregressive == bool(history)
    maps = torch.randn(2, config.inputs, 32, 32, requires_grad=True)
    made = method.net.eval()(maps)
    assert made.shape == (2, 9, 32, 32)
    for decoder in made.split(3, dim=1):
        (slope,) = torch.autograd.grad(decoder.square().sum(), maps, retain_graph=True)
        assert (slope.abs().amax((0, 2, 3)) > 0).all()


@pytest.mark.parametrize("frame", ["world", "body"])
@pytest.mark.parametrize("anchor", ["body", "smooth_lbs"])
def test_decoding_undoes_encoding(frame, anchor, body, prepared, outfit):
    """A smooth deformation of the garment survives map and back within 2 mm, in every frame and anchor."""
    config = replace(TINY, frame=frame, anchor=anchor)
    transforms = swaying(4, seed=1).transforms()
    posed = skin(body.mesh.vertices, body.weights, transforms)
    for garment in outfit.garments:
        worn, template = prepared.decoders[garment.template], prepared.templates[garment.template]
        moved, frames = skin_frames(worn.points, worn.smooth_weights, transforms)
        swing = 0.03 * torch.sin(8.0 * worn.points[:, 2:] + torch.arange(3.0))
        vertices = moved + rotate(frames, swing)
        offsets = template_offsets(
            config,
            prepared.texels,
            template,
            worn,
            vertices=vertices,
            body_vertices=posed,
            transforms=transforms,
        )
        decoded = garment_vertices(
            config,
            prepared.texels,
            template,
            worn,
            offsets=offsets,
            body_vertices=posed,
            transforms=transforms,
        )
        error = (decoded - vertices).norm(dim=-1)
        assert error.mean() < 2e-3
        assert error.mean() < 0.1 * (vertices - moved).norm(dim=-1).mean()


def test_specific_force_at_rest_points_up_in_any_pose(body, prepared):
    """A body that stands still feels the ground: 9.81 m/s2 upwards in the world, in each texel's axes."""
    pose = swaying(8, seed=2).transforms()[3:4].repeat(5, 1, 1, 1)
    frames = body_frames(body, pose, 30.0)
    values = motion_values(
        replace(TINY, size=64),
        prepared.texels,
        frames.velocity[:, -1],
        frames.acceleration[:, -1],
        frames.transforms[:, -1],
    )
    assert values[:, :3].abs().max() < 1e-4
    _, axes = skin_frames(prepared.texels.points, prepared.texels.weights, pose[:1])
    world = rotate(axes, values[:, 3:].transpose(1, 2))
    torch.testing.assert_close(world, -torch.tensor(FREE_FALL).expand_as(world), atol=2e-2, rtol=0.0)


def test_motion_in_body_axes_does_not_depend_on_the_heading(body, prepared):
    motion = swaying(6, seed=3).transforms()
    turn = torch.tensor([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    seen = []
    for transforms in (motion, turn @ motion):
        frames = body_frames(body, with_lead(transforms), 30.0)
        now = frames.velocity[:, -1], frames.acceleration[:, -1], frames.transforms[:, -1]
        seen.append(motion_values(TINY, prepared.texels, *now))
    torch.testing.assert_close(seen[0], seen[1], atol=5e-3, rtol=1e-3)


def test_mirroring_a_motion_mirrors_its_maps(body, prepared):
    """The mirror image of a velocity field bakes to the mirrored map: the layout is symmetric."""
    config = replace(TINY, frame="world", acceleration="plain")
    points = body.mesh.vertices
    velocity = torch.stack(
        [points[:, 2], points[:, 0] ** 2 + points[:, 1], points[:, 0] + points[:, 2]], dim=1
    )
    reflected = points * torch.tensor([-1.0, 1.0, 1.0])
    mirrored = torch.stack(
        [-reflected[:, 2], reflected[:, 0] ** 2 + reflected[:, 1], reflected[:, 0] + reflected[:, 2]], dim=1
    )
    still = torch.eye(3, 4).repeat(1, len(body.skeleton.names), 1, 1)
    maps = []
    for field in (velocity, mirrored):
        values = motion_values(config, prepared.texels, field[None], field[None], still)
        maps.append(prepared.texels.sheet.pixels.new_zeros(1, 6, 64 * 64).float())
        maps[-1][..., prepared.texels.sheet.pixels] = values
    error = (mirror(maps[0].unflatten(2, (64, 64))) - maps[1].unflatten(2, (64, 64))).abs()
    assert error.max() < 0.02


def test_an_untrained_change_of_zero_is_the_carrier(body, outfit):
    """With a network that predicts nothing, the garment is the smoothly skinned one: rest in, rest out."""
    method = PhysXNet.untrained(TINY)
    for parameter in method.net.parameters():
        parameter.data.zero_()
    transforms = swaying(3, seed=4).transforms()
    still = torch.eye(3, 4).repeat(1, transforms.shape[1], 1, 1)
    for frame, pose in zip(
        rollout(method, outfit, torch.cat([still, transforms]), 30.0, clear=False),
        torch.cat([still, transforms]),
        strict=True,
    ):
        for garment, vertices in zip(outfit.garments, frame.vertices, strict=True):
            expected = skin(garment.mesh.vertices, garment.smooth_weights, pose[None])[0]
            torch.testing.assert_close(vertices, expected, atol=1e-5, rtol=0.0)


def test_a_network_that_sees_poses_alone_does_not_see_how_fast_they_came(body, outfit):
    torch.manual_seed(0)
    motion = swaying(6, seed=5).transforms()
    for sees_motion in (False, True):
        method = PhysXNet.untrained(replace(TINY, history=0, motion=sees_motion))
        method.net.output_scale.fill_(0.01)
        slow, fast = (
            [*rollout(method, outfit, motion, fps, clear=False)][-1].vertices[0] for fps in (30.0, 60.0)
        )
        assert torch.equal(slow, fast) != sees_motion


@pytest.mark.parametrize("history", [0, 2])
@pytest.mark.parametrize("sees_motion", [True, False])
def test_a_saved_model_predicts_the_same(history, sees_motion, body, outfit, tmp_path):
    torch.manual_seed(0)
    method = PhysXNet.untrained(replace(TINY, history=history, motion=sees_motion))
    method.net.output_scale.fill_(0.01)
    method.net.half().float()  # files are in half precision
    save_checkpoint(physxnet_checkpoint(method, body, TrainingData(), {}), tmp_path / "walker")
    loaded = load_method(tmp_path / "walker", body)
    assert loaded.name == "walker"
    motion = swaying(3, seed=5).transforms()
    for before, after in zip(
        rollout(method, outfit, motion, 30.0, clear=False),
        rollout(loaded, outfit, motion, 30.0, clear=False),
        strict=True,
    ):
        for a, b in zip(before.vertices, after.vertices, strict=True):
            assert torch.equal(a, b)


def test_a_loaded_model_that_is_saved_again_loads(body, tmp_path):
    method = PhysXNet.untrained(TINY)
    save_checkpoint(physxnet_checkpoint(method, body, TrainingData(), {}), tmp_path / "walker")
    loaded = load_method(tmp_path / "walker", body)
    save_checkpoint(physxnet_checkpoint(loaded, body, TrainingData(), {}), tmp_path / "again")
    again = load_method(tmp_path / "again", body)
    assert (again.name, again.config) == ("again", TINY)
    for name, tensor in loaded.net.state_dict().items():
        assert torch.equal(again.net.state_dict()[name], tensor)


def test_history_changes_the_second_frame_only(body, outfit):
    torch.manual_seed(0)
    method = PhysXNet.untrained(replace(TINY, history=1))
    method.net.output_scale.fill_(0.01)
    still = torch.eye(3, 4).repeat(2, len(body.skeleton.names), 1, 1)
    first, second = rollout(method, outfit, still, 30.0, clear=False)
    assert not torch.equal(first.vertices[0], second.vertices[0])


def test_refuses_a_template_without_decoder(body):
    trousers = Outfit(body, (fit_template("bottoms", body),))
    with pytest.raises(InputError, match="no decoder for template 'bottoms'"):
        next(iter(rollout(PhysXNet.untrained(TINY), trousers, swaying(1, seed=0).transforms(), 30.0)))


def test_a_network_that_knows_no_shirt_dresses_it_from_the_tops(body):
    outfit = Outfit(body, (fit_template("shirt", body),))
    method = PhysXNet.untrained(TINY)
    assert method.unsupported_reason(outfit) == ""
    torch.nn.init.zeros_(method.net.output_scale)
    walk = swaying(2, seed=0).transforms()
    carried = skin(outfit.garments[0].mesh.vertices, outfit.garments[0].smooth_weights, walk)
    for frame, expected in zip(rollout(method, outfit, walk, 30.0, clear=False), carried, strict=True):
        torch.testing.assert_close(frame.vertices[0], expected, atol=1e-5, rtol=0)
    assert replace(TINY, templates=("tops", "shirt")).decoder("shirt") == "shirt"
    skirts = PhysXNet.untrained(replace(TINY, templates=("dress",)))
    assert "no decoder for template 'shirt', it has dress" in skirts.unsupported_reason(outfit)


def test_refuses_weights_of_another_width(body, tmp_path):
    checkpoint = physxnet_checkpoint(PhysXNet.untrained(TINY), body, TrainingData(), {})
    save_checkpoint(replace(checkpoint, config={**checkpoint.config, "width": 16}), tmp_path)
    with pytest.raises(InputError, match="do not fit"):
        load_physxnet(load_checkpoint(tmp_path), tmp_path)


def test_a_name_almost_right_gets_a_hint(body):
    with pytest.raises(InputError, match="did you mean 'lbs_smooth'"):
        load_method("lbs_smoth", body)


def test_a_batch_predicts_what_single_frames_predict(body, outfit):
    torch.manual_seed(0)
    method = PhysXNet.untrained(TINY)
    frames = body_frames(body, with_lead(swaying(5, seed=6).transforms()), 30.0)
    together = predicted(method, outfit, frames)
    for index in range(len(frames)):
        alone = predicted(method, outfit, frames[index : index + 1])
        for a, b in zip(alone, together, strict=True):
            torch.testing.assert_close(a[0], b[index], atol=1e-5, rtol=0.0)
