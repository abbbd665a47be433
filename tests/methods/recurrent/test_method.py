"""Recurrent rigs: one frame after another is the sequence, seen from the root, and as engines play it."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.checkpoint import TrainingData, load_checkpoint, save_checkpoint
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.rotations import from_axis_angles
from uvcloth.geometry.skinning import skin
from uvcloth.methods.recurrent.body_motion import body_motion, held_still
from uvcloth.methods.recurrent.method import Recurrent, load_recurrent, recurrent_checkpoint
from uvcloth.methods.recurrent.network import (
    TICK,
    RecurrentConfig,
    RecurrentNetwork,
    RecurrentNetworks,
)
from uvcloth.motion.library import load_clip
from uvcloth.motion.stop import come_to_rest
from uvcloth.rollouts.rollout import rollout
from uvcloth.writers.recurrent import write_recurrent
from uvcloth.writers.rig import rig_of

CONFIG = RecurrentConfig(shapes=3, width=16)
FPS = 30.0


@pytest.fixture(scope="module")
def outfit(body: Body) -> Outfit:
    return Outfit(body, tuple(fit_template(name, body) for name in ("bottoms", "tops")))


@pytest.fixture(scope="module")
def method(outfit: Outfit) -> Recurrent:
    """Networks with random weights, whose shapes move centimetres; the cages are a few of the vertices."""
    generator = torch.Generator().manual_seed(5)
    networks: dict[str, RecurrentNetwork] = {}
    joints = len(outfit.body.skeleton.names)
    for garment in outfit.garments:
        count = len(garment.mesh.vertices)
        network = RecurrentNetwork(CONFIG, joints, cage=40, vertices=count)
        network.spread.fill_(3.0)
        network.scale.fill_(1.0)
        network.shapes.copy_(0.02 * torch.randn(3, 40, 3, generator=generator))
        network.extremes.copy_(torch.randn(6, 3, generator=generator))
        network.corners.copy_(torch.randint(40, (count, 3), generator=generator))
        network.shares.fill_(1.0 / 3.0)
        networks[garment.name] = network.eval()
    return Recurrent(CONFIG, RecurrentNetworks(networks))


@pytest.fixture(scope="module")
def stopping(body: Body) -> Tensor:
    """Joint transforms (T, J, 3, 4) of a run that stops."""
    return come_to_rest(load_clip("run", body).window(0, 14), 0.6).transforms()


def garments_of(method: Recurrent, outfit: Outfit, transforms: Tensor, fps: float = FPS) -> Sequence[Tensor]:
    frames = [frame.raw for frame in rollout(method, outfit, transforms, fps, clear=False)]
    return [torch.stack(each) for each in zip(*frames, strict=True)]


def test_frame_by_frame_is_the_sequence_that_was_trained(method: Recurrent) -> None:
    network = method.networks.of("tops")
    inputs, condition = torch.randn(2, 9, len(network.center)), torch.randn(len(network.usual))
    told = network.conditioned(condition)
    with torch.no_grad():
        hidden, stepped = torch.zeros(2, CONFIG.width), []
        for frame in inputs.unbind(1):
            weights, hidden = told.step(frame, hidden, 1.0)
            stepped.append(weights)
        expected = network(inputs, condition.expand(2, -1))
        torch.testing.assert_close(torch.stack(stepped, 1), expected, atol=1e-5, rtol=0)
        plain = network(inputs, network.usual.expand(2, -1))
        assert float((plain - expected).abs().max()) > 1e-3


def test_half_ticks_lead_where_whole_ones_do(method: Recurrent) -> None:
    """Exactly so where what the state tends to is constant; at another frame rate it is the same motion."""
    network = RecurrentNetwork(CONFIG, 2, 1, 1).eval()
    network.load_state_dict(
        {key: 0.0 * value if "hh" in key else value for key, value in network.state_dict().items()}
    )
    inputs, start = torch.randn(4, len(network.center)), torch.randn(4, CONFIG.width)
    with torch.no_grad():
        half = network.step(inputs, network.step(inputs, start, 0.5)[1], 0.5)[1]
        torch.testing.assert_close(half, network.step(inputs, start, 1.0)[1], atol=1e-5, rtol=0)


def test_the_motion_is_the_same_wherever_the_body_is_and_faces(outfit: Outfit, stopping: Tensor) -> None:
    turn = from_axis_angles(torch.tensor([0.0, 0.0, 2.0]))
    moved = turn @ stopping
    moved[..., 3] += torch.tensor([3.0, -2.0, 0.5])
    heads = outfit.body.skeleton.heads
    near, far = (body_motion(each.unfold(0, 3, 1).movedim(-1, 1), heads, FPS) for each in (stopping, moved))
    torch.testing.assert_close(near, far, atol=5e-3, rtol=0)


def test_gravity_is_felt_by_a_body_at_rest_and_not_in_free_fall(outfit: Outfit) -> None:
    heads = outfit.body.skeleton.heads
    joints = len(heads)
    still = torch.eye(3, 4).expand(1, 3, joints, 3, 4).clone()
    falling = still.clone()
    falling[:, 1, :, 2, 3] = -0.5 * 9.81 / FPS**2
    falling[:, 2, :, 2, 3] = -0.5 * 9.81 * (2 / FPS) ** 2
    resting, free = (
        body_motion(each, heads, FPS)[0, : 15 * joints].view(joints, 15) for each in (still, falling)
    )
    torch.testing.assert_close(resting[:, 12:], torch.tensor([0.0, 0.0, 9.81]).expand(joints, 3))
    torch.testing.assert_close(free[:, 12:], torch.zeros(joints, 3), atol=1e-2, rtol=0)


def test_garments_move_on_after_a_stop_by_their_memory_alone(
    method: Recurrent, outfit: Outfit, stopping: Tensor
) -> None:
    config = replace(CONFIG, memory=False)
    forgetful: dict[str, RecurrentNetwork] = {}
    for garment in outfit.garments:
        own = method.networks.of(garment.name)
        forgetful[garment.name] = RecurrentNetwork(config, len(stopping[0]), 40, len(own.corners))
        forgetful[garment.name].load_state_dict(own.state_dict())
    without = Recurrent(config, RecurrentNetworks(forgetful))
    standing = int((stopping.diff(dim=0).abs().amax((1, 2, 3)) > 1e-6).nonzero().max()) + 4
    for each, moves in ((method, True), (without, False)):
        after = garments_of(each, outfit, stopping)[0][standing:]
        assert (float(after.diff(dim=0).abs().max()) > 1e-6) == moves


def test_a_body_held_still_is_one_that_stands_in_the_pose_of_a_motion(
    outfit: Outfit, stopping: Tensor
) -> None:
    heads = outfit.body.skeleton.heads
    moving = body_motion(stopping.unfold(0, 3, 1).movedim(-1, 1), heads, FPS)
    standing = body_motion(stopping[2:, None].expand(-1, 3, -1, -1, -1), heads, FPS)
    torch.testing.assert_close(held_still(moving), standing, atol=1e-3, rtol=0)
    assert float((moving - standing).abs().max()) > 1.0


def test_dynamics_scale_what_motion_adds_to_the_rest_in_each_pose(
    method: Recurrent, outfit: Outfit, stopping: Tensor
) -> None:
    """What is left without dynamics is what the network tends to on a body that stands in the pose."""
    heads = outfit.body.skeleton.heads
    none, once, twice = (
        torch.cat(garments_of(method.with_dynamics(factor), outfit, stopping), 1)
        for factor in (0.0, 1.0, 2.0)
    )
    skinned = method.as_rig(outfit.body, outfit.garments)
    motion = body_motion(stopping[:, None].expand(-1, 3, -1, -1, -1), heads, FPS)
    with torch.no_grad():
        settled = torch.cat(
            [
                each.network.step(each.network.normalized(motion), hidden, 1.0)[0]
                for each in skinned.networks
                for hidden in [each.at_rest(motion)]
            ],
            dim=1,
        )
    for frame in (0, 6, 12, 30):
        points = skinned.rest + torch.tensordot(settled[frame], skinned.shapes, 1)
        posed = skin(points, skinned.weights, stopping[frame][None])[0]
        torch.testing.assert_close(none[frame], posed, atol=1e-3, rtol=0)
    assert float((once - none).norm(dim=-1).max()) > 0.005
    torch.testing.assert_close(twice - none, 2.0 * (once - none), atol=1e-4, rtol=0)
    torch.testing.assert_close(once, torch.cat(list(garments_of(method, outfit, stopping)), 1))


def test_a_saved_model_moves_the_same(
    method: Recurrent, outfit: Outfit, stopping: Tensor, tmp_path: Path
) -> None:
    save_checkpoint(recurrent_checkpoint(method, outfit.body, TrainingData(), {}), tmp_path)
    loaded = load_recurrent(load_checkpoint(tmp_path, outfit.body), tmp_path)
    for own, read in zip(
        garments_of(method, outfit, stopping[:9]), garments_of(loaded, outfit, stopping[:9]), strict=True
    ):
        assert float((own - read).norm(dim=-1).max()) < 1e-3  # Half precision.
    broken = recurrent_checkpoint(method, outfit.body, TrainingData(), {})
    broken.tensors["tops.corners"][0, 0] = 40
    save_checkpoint(broken, tmp_path)
    with pytest.raises(InputError, match="corner"):
        load_recurrent(load_checkpoint(tmp_path, outfit.body), tmp_path)
    broken.tensors["tops.corners"][0, 0] = 0


def test_other_garments_are_refused_by_name(method: Recurrent, body: Body) -> None:
    dress = Outfit(body, (fit_template("dress", body),))
    assert method.unsupported_reason(dress) == (
        "garment dress: model recurrent is for the templates bottoms, tops"
    )


def test_its_rig_played_by_skinning_is_the_rollout(
    method: Recurrent, outfit: Outfit, stopping: Tensor
) -> None:
    rig = method.as_rig(outfit.body, outfit.garments)
    with torch.no_grad():
        weights = rig.play(stopping, FPS)
    expected = torch.cat(list(garments_of(method, outfit, stopping)), dim=1)
    for frame in (0, 8, 20):
        points = rig.rest + torch.tensordot(weights[frame], rig.shapes, 1)
        posed = skin(points, rig.weights, stopping[frame][None])[0]
        torch.testing.assert_close(posed, expected[frame], atol=1e-4, rtol=0)


def test_a_livelier_rig_has_room_for_weights_that_go_farther(method: Recurrent, outfit: Outfit) -> None:
    """Weights beyond the known ones would be clamped in engines."""
    calm, once, twice = (
        method.with_dynamics(factor).as_rig(outfit.body, outfit.garments).known()
        for factor in (0.5, 1.0, 2.0)
    )
    torch.testing.assert_close(calm, once)
    spans = (each.amax(0) - each.amin(0) for each in (once, twice))
    torch.testing.assert_close(2.0 * next(spans), next(spans))


@pytest.mark.parametrize("dynamics", [1.0, 1.5])
def test_onnx_plays_the_rig_with_its_memory(
    method: Recurrent, outfit: Outfit, stopping: Tensor, tmp_path: Path, dynamics: float
) -> None:
    pytest.importorskip("onnx")
    onnxruntime = pytest.importorskip("onnxruntime")
    rig = method.with_dynamics(dynamics).as_rig(outfit.body, outfit.garments)
    rigged = rig_of(rig, outfit.body)
    write_recurrent(rig, rigged, tmp_path / "rig.onnx")
    session = onnxruntime.InferenceSession(tmp_path / "rig.onnx")
    memory, hidden = np.zeros((1, rig.memory), np.float32), torch.zeros(1, rig.memory)
    for joints in stopping.unfold(0, 3, 1).movedim(-1, 1).split(1):
        given = {
            "joints": joints.contiguous().numpy(),
            "memory": memory,
            "seconds": np.array([TICK], np.float32),
        }
        weights, memory = session.run(["weights", "next_memory"], given)
        with torch.no_grad():
            expected, hidden = rig.step(joints, hidden, TICK)
        np.testing.assert_allclose(memory, hidden, atol=1e-5)
        np.testing.assert_allclose(weights, rigged.code.weights(expected), atol=1e-5)
