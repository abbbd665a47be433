"""A waving body in a cut-open outfit: two garments with texture seams, and the clips and models of it."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.writers.played import rolled_out
from uvcloth.bodies.body import Body, load_body
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skinning import skin
from uvcloth.methods.capabilities import Riggable
from uvcloth.methods.deepsd.config import PRESETS
from uvcloth.methods.deepsd.method import DeePSD
from uvcloth.methods.deepsd.network import DeePSDNetwork
from uvcloth.methods.method import Method
from uvcloth.methods.pbns.method import PBNS, new_network, rest_outfit
from uvcloth.methods.pbns.network import PBNSConfig
from uvcloth.methods.rig import PoseRig, pose_vectors
from uvcloth.motion.clip import Clip
from uvcloth.writers.animation import Animation

FRAMES = 40


def _patch(body: Body, name: str, low: float, high: float) -> Garment:
    mesh = body.mesh
    height = mesh.vertices[:, 2]
    kept = ((height[mesh.faces] > low) & (height[mesh.faces] < high)).all(1)
    used, faces = mesh.faces[kept].unique(return_inverse=True)
    used_uvs, face_uvs = mesh.face_uvs[kept].unique(return_inverse=True)
    cut = Mesh(mesh.vertices[used] * 1.02, faces, mesh.uvs[used_uvs], face_uvs)
    return Garment(name, "tops", cut, body.weights[used], body.weights[used])


def _waving(body: Body, name: str, swing: float) -> Clip:
    joints = len(body.skeleton.names)
    time = torch.linspace(0, 2 * math.pi, FRAMES)
    angles = swing * torch.sin(time[:, None] + torch.arange(joints) * 0.7)
    axes = torch.nn.functional.normalize(
        torch.randn(joints, 3, generator=torch.Generator().manual_seed(1)), dim=1
    )
    skew = torch.zeros(joints, 3, 3)
    for row, column, axis, sign in ((0, 1, 2, -1), (0, 2, 1, 1), (1, 2, 0, -1)):
        skew[:, row, column] = sign * axes[:, axis]
        skew[:, column, row] = -sign * axes[:, axis]
    rotations = torch.linalg.matrix_exp(angles[..., None, None] * skew)
    path = torch.stack([0.3 * time, -0.5 * time, 0.9 + 0 * time], dim=1)
    return Clip(name, body.skeleton, rotations, path, 30.0)


@pytest.fixture(scope="session")
def body() -> Body:
    return load_body()


@pytest.fixture(scope="session")
def outfit(body: Body) -> Outfit:
    return Outfit(body, (_patch(body, "shirt", 0.9, 1.4), _patch(body, "trousers", 0.4, 0.9)))


@pytest.fixture(scope="session")
def clip(body: Body) -> Clip:
    return _waving(body, "wave", 0.5)


@pytest.fixture(scope="session")
def practice(body: Body) -> Clip:
    """What the models were trained on: the same with smaller swings, so that `clip` leaves its range."""
    return _waving(body, "practice", 0.4)


@pytest.fixture(scope="session")
def animation(body: Body, outfit: Outfit, clip: Clip) -> Animation:
    transforms = clip.transforms()
    return Animation(
        names=tuple(garment.name for garment in outfit.garments),
        meshes=tuple(garment.mesh for garment in outfit.garments),
        vertices=tuple(skin(g.mesh.vertices, g.weights, transforms).numpy() for g in outfit.garments),
        body=body,
        transforms=transforms.numpy(),
        fps=clip.fps,
    )


@pytest.fixture(scope="session")
def make_pbns(outfit: Outfit, practice: Clip) -> Callable[..., PBNS]:
    """A PBNS as if trained on `practice` and the rest pose: smooth blend shapes of centimetres."""

    def make(influences: int = 4) -> PBNS:
        config = PBNSConfig(width=24, layers=3, influences=influences)
        worn = rest_outfit(outfit)
        rest = torch.eye(3, 4).expand(1, len(worn.heads), 3, 4)
        poses = pose_vectors(worn.parents, torch.cat([rest, practice.transforms()]))
        torch.manual_seed(3)
        weights = torch.cat([garment.weights for garment in outfit.garments])
        network = new_network(config, worn, weights, poses)
        with torch.no_grad():
            for layer in network.layers:
                layer.weight *= 2.5
            places = torch.zeros(len(network.strongest), 3).index_copy(0, network.owner, network.rest)
            waves = torch.sin(places @ (8 * torch.randn(3, 24)) + 6 * torch.rand(24)).T
            network.shapes.copy_((0.01 * waves[..., None] * torch.randn(24, 1, 3)).flatten(1))
        return PBNS(config, network.eval(), worn)

    return make


@pytest.fixture(scope="session")
def pbns(make_pbns: Callable[..., PBNS]) -> PBNS:
    return make_pbns()


@pytest.fixture(scope="session")
def deepsd(practice: Clip) -> DeePSD:
    """A DeePSD as if trained on `practice`: blend shapes of centimetres, keys that pass 1 before division."""
    parents = practice.skeleton.parents
    torch.manual_seed(3)
    config = replace(PRESETS["tiny"], keys=24)
    network = DeePSDNetwork(config, len(parents))
    vectors = pose_vectors(parents, practice.transforms())
    with torch.no_grad():
        network.pose_mean.copy_(vectors.mean(0))
        network.pose_scale.copy_(vectors.std(0) + 0.1)
        for layer in network.embedding.children():
            layer.weight *= 2.5
        for layers in network.branches.values():
            for layer in layers.children():
                layer.weight *= 4.0
    return DeePSD(config, network.eval(), vectors)


@pytest.fixture(scope="session", params=["pbns", "deepsd"])
def model(request: pytest.FixtureRequest) -> Method:
    """Each method that is a rig."""
    found: Method = request.getfixturevalue(request.param)
    return found


@pytest.fixture(scope="session")
def pose_rig(model: Method, outfit: Outfit) -> PoseRig:
    riggable = model.capability(Riggable)
    assert riggable is not None
    return riggable.as_rig(outfit.body, outfit.garments)


@pytest.fixture(scope="session")
def rolled(model: Method, outfit: Outfit, clip: Clip) -> list[np.ndarray]:
    """Per garment (F, N, 3) m: what the model's rollout makes of the clip."""
    return rolled_out(model, outfit, clip)
