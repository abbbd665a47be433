"""Trained models of a web page: a visitor's browser plays rigs, and stored frames of others."""

from collections.abc import Sequence
from pathlib import Path

import torch

from uvcloth.bodies.body import Body, load_body
from uvcloth.commands.run.page_methods import PageMethod
from uvcloth.dataset.clip import REST_TOLERANCE, SimulatedClip, SimulatedGarment
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.loading import load_outfit
from uvcloth.methods.capabilities import Riggable, before_finish
from uvcloth.methods.method import Method
from uvcloth.methods.recurrent.rig import RecurrentRig
from uvcloth.methods.registry import load_method
from uvcloth.methods.rig import PoseRig
from uvcloth.physics.fabric import FabricName
from uvcloth.rollouts.rollout import rollout
from uvcloth.writers.page_frames import pack_frames
from uvcloth.writers.page_pose import pack_pose
from uvcloth.writers.page_recurrent import pack_recurrent


def recurrent_of(names: Sequence[str]) -> PageMethod:
    """The recurrent rig that ships, of some templates on our own body."""
    body = load_body()
    rigged = _rigged(load_method("recurrent", body), body, load_outfit(names, body))
    assert rigged is not None
    return rigged


def model_methods(
    models: Sequence[str],
    body: Path | None,
    clip: SimulatedClip,
    garment: SimulatedGarment,
    fabric: FabricName | None,
) -> list[PageMethod]:
    """Models of `--model` over the motion of a simulation, as predicted, without a finish.

    Raises InputError as loading does, for a garment that is no template of the same mesh, and for a model
    that cannot dress it.
    """
    if not models:
        return []
    on = load_body(body)
    (loaded,) = load_outfit((garment.name,), on, fabric=fabric)
    rest = loaded.mesh.vertices
    if rest.shape != garment.rest.shape or not (rest - garment.rest).norm(dim=1).max() <= REST_TOLERANCE:
        raise InputError(
            f"--model: the simulated {garment.name} is not the template of that name on body {on.name}"
        )
    methods = []
    for model in models:
        method = before_finish(load_method(model, on))
        outfit = Outfit(on, (loaded,))
        if reason := method.unsupported_reason(outfit):
            raise InputError(f"--model {model}: {reason}")
        if rigged := _rigged(method, on, (loaded,)):
            methods.append(rigged)
            continue
        frames = rollout(method, outfit, clip.transforms.double(), clip.fps, clear=False)
        points = torch.stack([frame.in_world().vertices[0] for frame in frames])
        methods.append(
            PageMethod(method.name, "frames", pack_frames(points.float().numpy(), garment.faces.numpy()))
        )
    return methods


def _rigged(method: Method, body: Body, garments: tuple[Garment, ...]) -> PageMethod | None:
    """A method as a rig that the browser plays, None if it is none."""
    riggable = method.capability(Riggable)
    rig = riggable.as_rig(body, garments) if riggable else None
    if isinstance(rig, RecurrentRig):
        return PageMethod(method.name, "recurrent", pack_recurrent(rig))
    return PageMethod(method.name, "pose", pack_pose(rig)) if isinstance(rig, PoseRig) else None
