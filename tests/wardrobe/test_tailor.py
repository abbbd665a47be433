"""Tailoring: templates at another density, kept in files."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from rasterize.charts import boundary_loops
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments import templates
from uvcloth.garments.shells import TEMPLATE_SKIRT
from uvcloth.garments.templates import load_template, save_template, tailored
from uvcloth.physics.surface import BodySurface
from uvcloth.wardrobe.tailor import tailor


def test_a_coarse_skirt_has_a_waist_and_a_hem(body: Body) -> None:
    pytest.importorskip("pyacvd", reason="tailoring needs the remesher of uvcloth[body]")
    made = tailor("skirt", body, 600)
    mesh = tailored(made, body)
    assert len(mesh.vertices) == pytest.approx(600, rel=0.05)
    assert len(boundary_loops(mesh.faces.numpy())) == 2
    skin = BodySurface(body.mesh.vertices, body.mesh.faces).closest(mesh.vertices)
    assert float(skin.signed_distance.min()) > templates.LEAST_CLEARANCE - 5e-4
    assert 0 < int(made.band.sum()) < 100


@pytest.mark.parametrize("name", ["skirt", "jacket"])
def test_the_cut_of_a_skirt_and_the_lift_of_a_jacket_survive_the_file(
    name: str, body: Body, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    template = load_template(name)
    (tmp_path / "data" / "templates").mkdir(parents=True)
    save_template(template, tmp_path / "data" / "templates" / f"{name}.npz")
    monkeypatch.setattr(templates, "files", lambda package: tmp_path)
    again = load_template.__wrapped__(name)
    assert torch.equal(tailored(again, body).vertices, tailored(template, body).vertices)
    plain = replace(template, lift=torch.zeros_like(template.lift), skirt=TEMPLATE_SKIRT)
    assert not torch.allclose(tailored(plain, body).vertices, tailored(template, body).vertices, atol=5e-3)


def test_an_unknown_template_is_not_tailored(body: Body) -> None:
    with pytest.raises(InputError, match="cape"):
        tailor("cape", body, 600)
