"""The model that is taken where none is named, and the reason that is given."""

import pytest
import torch
import trimesh

from uvcloth.bodies.body import load_body
from uvcloth.errors import InputError
from uvcloth.garments.fit import make_fitted
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import Mesh
from uvcloth.methods import automatic
from uvcloth.methods.automatic import choose_model, named_models


def closed() -> Garment:
    """A ball around the trunk, which no hem holds."""
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=0.35)
    vertices, faces = torch.tensor(sphere.vertices).float(), torch.tensor(sphere.faces)
    mesh = Mesh(vertices, faces, vertices[:, :2], faces)
    return make_fitted("ball", mesh, load_body(), "tops")[0]


def test_the_solver_moves_what_a_hem_holds_and_another_model_the_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    body = load_body()
    dress = fit_template("dress", body)
    assert named_models(["auto"], Outfit(body, (dress,))) == (
        ("physics",),
        "model physics: every garment has a hem that holds it",
    )
    choice = choose_model(Outfit(body, (dress, closed())))
    assert choice.model == "physxnet"
    assert choice.line.startswith("model physxnet: not physics, garment ball: cannot be simulated")

    def absent(*_: object) -> None:
        raise InputError("a model of another body")

    monkeypatch.setattr(automatic, "load_method", absent)
    choice = choose_model(Outfit(body, (closed(),)))
    assert choice.model == "lbs_smooth"
    assert choice.line.endswith("no trained model has this body")


def test_models_that_are_named_are_taken_and_auto_stands_alone() -> None:
    outfit = Outfit(load_body(), ())
    assert named_models(["lbs", "deepsd"], outfit) == (("lbs", "deepsd"), None)
    with pytest.raises(InputError, match="--model auto: is chosen for all garments together"):
        named_models(["lbs", "auto"], outfit)
