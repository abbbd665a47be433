"""DeePSD without training: the rig that it writes for any mesh, and what it says of what it cannot dress."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from tests.methods.pbns.test_method import outfit_of, sheet, some_motion
from tests.methods.stepping import predicted
from tests.small_body import small_body
from uvcloth.bodies.frames import body_frames, with_lead
from uvcloth.checkpoint import WEIGHTS, TrainingData, load_tensors, save_checkpoint, save_tensors
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.mesh import Mesh
from uvcloth.methods.capabilities import Riggable, before_finish
from uvcloth.methods.deepsd.config import PRESETS, DeePSDConfig
from uvcloth.methods.deepsd.method import DeePSD, deepsd_checkpoint
from uvcloth.methods.deepsd.network import DeePSDNetwork
from uvcloth.methods.ensemble import Ensemble
from uvcloth.methods.lbs import LBSConfig, create_lbs
from uvcloth.methods.registry import load_method
from uvcloth.methods.resized import Resized
from uvcloth.methods.rig import pose_vectors
from uvcloth.physics.fabric import FABRICS
from uvcloth.rollouts.rollout import rollout

TINY = replace(PRESETS["tiny"], blend_weights="changed", influences=2)
JOINTS = 2


def random_deepsd(config: DeePSDConfig = TINY) -> DeePSD:
    """With blend shapes of decimetres."""
    torch.manual_seed(2)
    network = DeePSDNetwork(config, JOINTS)
    with torch.no_grad():
        for layers in network.branches.values():
            for layer in layers.children():
                layer.weight.mul_(3.0)
    return DeePSD(config, network.eval(), torch.rand(6, 3 * JOINTS))


def moved(method: DeePSD, outfit: Outfit) -> tuple[Tensor, ...]:
    """The garments (B, N, 3) in four poses."""
    return predicted(method, outfit, body_frames(outfit.body, with_lead(some_motion(outfit.body)), 30.0))


def test_a_step_is_the_equation_written_out() -> None:
    outfit, method = outfit_of("shirt", "coat"), random_deepsd()
    motion = some_motion(outfit.body)
    rig = method.as_rig(outfit.body, outfit.garments)
    keys = rig.embed(pose_vectors(rig.parents, motion)).numpy()
    np.testing.assert_allclose(keys.sum(1), 1.0, atol=1e-6)
    rest = rig.rest.numpy() + np.einsum("bk,knc->bnc", keys, rig.shapes.numpy()[:, rig.owner])
    blended = np.einsum("nj,bjrc->bnrc", rig.weights.numpy()[rig.owner], motion.numpy())
    expected = np.einsum("bnrc,bnc->bnr", blended[..., :3], rest) + blended[..., 3]
    made = torch.cat(moved(method, outfit), dim=1).numpy()
    np.testing.assert_allclose(made, expected, atol=1e-5)
    skinned = np.einsum("bnrc,nc->bnr", blended[..., :3], rig.rest.numpy()) + blended[..., 3]
    assert np.abs(made - skinned).max() > 0.01


def test_keys_that_are_all_zero_deform_nothing() -> None:
    outfit, method = outfit_of("shirt"), random_deepsd()
    with torch.no_grad():
        *_, last = method.network.embedding.children()
        assert isinstance(last, nn.Linear)
        last.weight.zero_()
        last.bias.fill_(-1.0)
    rig = method.as_rig(outfit.body, outfit.garments)
    assert not rig.embed(method.poses).any()
    still = torch.eye(3, 4).expand(1, JOINTS, 3, 4)
    (made,) = predicted(method, outfit, body_frames(outfit.body, with_lead(still), 30.0))
    torch.testing.assert_close(made[0], outfit.garments[0].mesh.vertices)


def test_doubled_vertices_at_seams_stay_together() -> None:
    """Also where their blend weights differ, as vertices 2 and 4, 3 and 5 of the sheet's do."""
    (made,) = moved(random_deepsd(), outfit_of("shirt"))
    assert torch.equal(made[:, [2, 3]], made[:, [4, 5]])
    assert (made[1:] - made[:1]).abs().max() > 0.01


def test_the_order_of_vertices_and_faces_means_nothing() -> None:
    outfit, method = outfit_of("shirt"), random_deepsd()
    mesh = outfit.garments[0].mesh
    # At the seam only the first vertex is asked for its weights.
    weights = outfit.garments[0].weights[[0, 1, 2, 3, 2, 3, 6, 7]]
    order = torch.tensor([5, 0, 7, 2, 4, 1, 6, 3])
    faces = order.argsort()[mesh.faces].flip(0).roll(1, 1)
    shuffled = Mesh(mesh.vertices[order], faces, torch.zeros(0, 2), faces)
    same = Garment("shirt", "tops", mesh, weights, weights)
    other = Garment("shirt", "tops", shuffled, weights[order], weights[order])
    (before,) = moved(method, replace(outfit, garments=(same,)))
    (after,) = moved(method, replace(outfit, garments=(other,)))
    torch.testing.assert_close(after, before[:, order], atol=1e-6, rtol=0)


def test_pieces_meet_in_the_descriptor_of_their_outfit_alone() -> None:
    both = Outfit(small_body(), (sheet("shirt"), sheet("coat", 0.6)))
    first = replace(both, garments=both.garments[:1])
    apart = random_deepsd(replace(TINY, global_layers=()))
    torch.testing.assert_close(moved(apart, both)[0], moved(apart, first)[0], atol=1e-6, rtol=0)
    together = random_deepsd()
    assert (moved(together, both)[0] - moved(together, first)[0]).abs().max() > 1e-4


def test_without_blend_shapes_it_is_skinning_and_still_a_rig() -> None:
    outfit, method = outfit_of("shirt"), random_deepsd(replace(TINY, deformation="none"))
    rig = method.as_rig(outfit.body, outfit.garments)
    assert rig.shapes.shape == (0, 6, 3)
    assert rig.embed(method.poses).shape == (6, 0)
    still = torch.eye(3, 4).expand(1, JOINTS, 3, 4)
    (made,) = predicted(method, outfit, body_frames(outfit.body, with_lead(still), 30.0))
    torch.testing.assert_close(made[0], outfit.garments[0].mesh.vertices)


def test_joints_come_and_go_with_no_weight() -> None:
    network = DeePSDNetwork(replace(PRESETS["tiny"], influences=2), 4)
    apart = 1e-4 * torch.tensor([1.0, -1.0])
    smooth = torch.tensor([0.5, 0.25, 0.25, 0.0]).repeat(2, 1)
    smooth[:, 1] += apart
    smooth[:, 2] -= apart
    weights = network.blend_weights(torch.zeros(2, 1), SimpleNamespace(smooth=smooth))
    torch.testing.assert_close(weights.sum(1), torch.ones(2))
    assert ((weights > 0).sum(1) == 2).all()
    assert (weights[0] - weights[1]).abs().max() < 1e-3
    alike = network.blend_weights(torch.zeros(1, 1), SimpleNamespace(smooth=torch.full((1, 4), 0.25)))
    torch.testing.assert_close(alike.sort().values, torch.tensor([[0.0, 0.0, 0.5, 0.5]]))


def test_another_fabric_is_another_rig_to_a_model_that_reads_it() -> None:
    """And to no other; the fabric of one garment is not that of the garment over it."""
    outfit = outfit_of("shirt", "coat")
    silk = replace(outfit.garments[0], fabric=FABRICS["silk"])
    mixed = replace(outfit, garments=(silk, outfit.garments[1]))
    blind, reads = random_deepsd(replace(TINY, reads_fabric=False)), random_deepsd()
    assert (blind.traits.reads_fabric, reads.traits.reads_fabric) == (False, True)
    assert torch.equal(moved(blind, mixed)[0], moved(blind, outfit)[0])
    before, after = moved(reads, outfit), moved(reads, mixed)
    assert (after[0] - before[0]).abs().max() > 1e-3
    torch.testing.assert_close(after[1], before[1], atol=1e-6, rtol=0)


def test_the_branch_of_physics_is_left_out_where_a_finish_follows() -> None:
    outfit, method = outfit_of("shirt"), random_deepsd()
    motion = some_motion(outfit.body)
    alone = moved(replace(method, branches=("data",)), outfit)[0]
    (both,) = moved(method, outfit)
    assert float((both - alone).norm(dim=-1).max()) > 0.01
    for clear, expected in ((True, alone), (False, both)):
        frames = rollout(method, outfit, motion, 30.0, clear)
        torch.testing.assert_close(torch.stack([frame.raw[0] for frame in frames]), expected)
    rig = replace(method, branches=("physics",))
    assert before_finish(rig) is rig


def test_several_methods_and_resized_ones_leave_to_a_finish_what_each_does() -> None:
    method, skinning = random_deepsd(), create_lbs(LBSConfig())
    several = before_finish(Ensemble.of((skinning, method)))
    assert several.methods[0] is skinning
    assert several.methods[1].branches == ("data",)
    resized = before_finish(Resized(method, 2.0, "twice"))
    assert resized.method.branches == ("data",)
    for same in (Ensemble.of((skinning, skinning)), Resized(skinning, 2.0, "twice")):
        assert before_finish(same) is same


def test_offsets_are_no_rig() -> None:
    outfit = outfit_of("shirt")
    method = random_deepsd(replace(TINY, deformation="offsets"))
    assert method.capability(Riggable) is None
    assert moved(method, outfit)[0].shape == (4, 8, 3)


def test_a_rig_needs_an_outfit_and_the_skeleton_of_training() -> None:
    method = random_deepsd()
    with pytest.raises(InputError, match=r"model deepsd rigs any outfit, so it needs one.*--garment"):
        method.as_rig(small_body())
    other = replace(method, network=DeePSDNetwork(TINY, 5))
    outfit = outfit_of("shirt")
    words = "model deepsd is for a skeleton of 5 joints, body 'box' has 2"
    assert other.unsupported_reason(outfit) == words
    for refused in (lambda: moved(other, outfit), lambda: other.as_rig(outfit.body, outfit.garments)):
        with pytest.raises(InputError, match=words):
            refused()


def saved(folder: Path) -> DeePSD:
    method = random_deepsd()
    body = small_body()
    save_checkpoint(deepsd_checkpoint(method, body, TrainingData({"data": "abc"}), {}), folder)
    return method


def test_a_saved_model_dresses_as_before(tmp_path: Path) -> None:
    method = saved(tmp_path / "mine")
    outfit = Outfit(small_body(), (sheet("shirt"), sheet("coat", 0.14)))
    loaded = load_method(tmp_path / "mine", outfit.body)
    assert loaded.name == "mine"
    for before, after in zip(moved(method, outfit), moved(loaded, outfit), strict=True):
        torch.testing.assert_close(before, after, atol=1e-3, rtol=0)


@pytest.mark.parametrize("name", ["poses", "network.weights.0.weight"])
def test_a_model_that_lacks_a_part_is_refused_by_its_folder(tmp_path: Path, name: str) -> None:
    saved(tmp_path / "mine")
    tensors, _ = load_tensors(tmp_path / "mine" / WEIGHTS)
    del tensors[name]
    save_tensors(tensors, {}, tmp_path / "mine" / WEIGHTS)
    with pytest.raises(InputError, match="mine"):
        load_method(tmp_path / "mine", small_body())
