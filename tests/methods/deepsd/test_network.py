"""What DeePSD's network sees of a pose, and how its layers begin."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from tests.methods.pbns.test_method import outfit_of
from uvcloth.methods.deepsd.config import PRESETS, DeePSDConfig
from uvcloth.methods.deepsd.network import LEAST_DEVIATION, DeePSDNetwork
from uvcloth.methods.deepsd.outfit_graph import PackedOutfits, outfit_graph, pack
from uvcloth.methods.rig import shares

TINY = PRESETS["tiny"]
JOINTS = 2
CPU = torch.device("cpu")


@pytest.fixture
def outfits() -> PackedOutfits:
    """Two outfits on a body of two joints."""
    return pack(
        [outfit_graph(outfit_of("shirt")), outfit_graph(outfit_of("shirt", "coat"))], CPU, TINY.spread
    )


def network(config: DeePSDConfig = TINY) -> DeePSDNetwork:
    torch.manual_seed(1)
    return DeePSDNetwork(config, JOINTS)


def poses() -> Tensor:
    """Pose vectors (50, 6); the last number hardly varies."""
    torch.manual_seed(2)
    return torch.randn(50, 3 * JOINTS) * torch.tensor([1.0, 2.0, 0.5, 0.3, 1.0, 1e-4]) + 0.7


@pytest.mark.parametrize(
    ("moved", "seen"), [(0.009, 0.0), (0.02, 0.5), (0.025, 0.75), (0.03, 1.0), (1.0, 1.0)]
)
def test_joints_are_seen_by_what_they_move(moved: float, seen: float) -> None:
    assert float(network().joint_visibility(torch.tensor([moved]))) == pytest.approx(seen, abs=1e-6)
    assert float(network(replace(TINY, seen_joints=0.0)).joint_visibility(torch.tensor([moved]))) == 1.0


def test_a_joint_moves_what_is_beyond_it_too() -> None:
    """The root moves all of an outfit, its child the area that the child's weights have."""
    outfit = outfit_of("shirt")
    assert outfit.body.skeleton.parents == (-1, 0)
    graph = outfit_graph(outfit)
    areas, moved = [], []
    for face in torch.cat(graph.faces):
        a, b, c = graph.points[face]
        areas.append(float(torch.linalg.cross(b - a, c - a).norm()))
        moved.append(areas[-1] * float(graph.smooth[face, 1].mean()))
    assert graph.joint_areas.tolist() == pytest.approx([1.0, sum(moved) / sum(areas)], rel=1e-5)
    assert 0.0 < float(graph.joint_areas[1]) < 1.0


def test_a_joint_that_is_not_seen_changes_no_key() -> None:
    net, known = network(), poses()
    turned = known.clone()
    turned[:, 3:] += 1.0
    unseen, seen = torch.tensor([1.0, 0.0]), torch.tensor([1.0, 1.0])
    torch.testing.assert_close(net.embed(known, unseen), net.embed(turned, unseen))
    assert not torch.allclose(net.embed(known, seen), net.embed(turned, seen), atol=1e-3)


def test_the_layers_of_a_rig_give_the_same_keys(outfits: PackedOutfits) -> None:
    net = network()
    net.standardize(poses(), outfits)
    seen = torch.tensor([1.0, 0.4])
    keys = poses()
    for weight, bias in net.embedding_layers(seen):
        keys = torch.relu(torch.nn.functional.linear(keys, weight, bias))
    torch.testing.assert_close(shares(keys), net.embed(poses(), seen), atol=1e-5, rtol=0)
    assert network(replace(TINY, keys=0)).embedding_layers(seen) == ()


def test_layers_begin_standardized(outfits: PackedOutfits) -> None:
    net = network()
    net.standardize(poses(), outfits)
    torch.testing.assert_close(net.pose_mean, poses().mean(0))
    assert float(net.pose_scale[-1]) == pytest.approx(LEAST_DEVIATION)
    described = net.describe(outfits)
    first, *_ = net.branches["data"].children()
    values = first(described)
    torch.testing.assert_close(values.mean(0), torch.zeros(values.shape[1]), atol=1e-4, rtol=0)
    torch.testing.assert_close(values.std(0, correction=0), torch.ones(values.shape[1]), atol=1e-3, rtol=0)


def test_the_paper_reads_metres_and_radians(outfits: PackedOutfits) -> None:
    config = replace(TINY, standardized=False)
    net, same = network(config), network(config)
    net.standardize(poses(), outfits)
    for name, value in net.state_dict().items():
        assert torch.equal(value, same.state_dict()[name]), name
    assert not PRESETS["paper"].standardized
