"""The fit command: what it prints, and the picture that it draws, also of a garment that it refuses."""

from pathlib import Path
from unittest.mock import Mock

import numpy as np
import OpenImageIO
import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.commands.fit import Fit
from uvcloth.commands.run import fit as examine_garment
from uvcloth.commands.run.fit import examine
from uvcloth.errors import InputError
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import Mesh
from uvcloth.methods.physics.method import Physics
from uvcloth.writers.obj import save_obj


def read_image(path: Path) -> np.ndarray:
    return np.asarray(OpenImageIO.ImageBuf(str(path)).get_pixels(OpenImageIO.UINT8))


def test_a_picture_shows_what_is_worn_and_what_is_refused(
    body: Body, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(examine_garment, "SIZE", (30, 44))
    monkeypatch.setattr(examine_garment, "MOMENTS", (0, 1, 2))
    monkeypatch.setitem(QUALITIES, "default", QUALITIES["fast"])
    shirt = fit_template("tops", body).mesh
    save_obj(shirt, tmp_path / "shirt.obj")
    picture = tmp_path / "fit.png"
    lines = examine(Fit(tmp_path / "shirt.obj", picture=picture))
    held = "  shirt: held up by its collar; it also has waist, cuffs, shoulders (--hold)"
    assert lines[-3:] == ["  worn as tops", held, str(picture)]
    worn = read_image(picture)
    assert worn.shape[0] > 2 * 44
    assert (worn[:44, :30] != worn[-44:, :30]).any()
    centre = (shirt.vertices.amax(0) + shirt.vertices.amin(0)) / 2
    turned = (shirt.vertices - centre) * torch.tensor([-1.0, 1.0, -1.0]) + centre
    save_obj(Mesh(turned, shirt.faces, shirt.uvs, shirt.face_uvs), tmp_path / "turned.obj")
    sentence = r"turned\.obj: the garment lies upside down: .*fit\.png shows it"
    with pytest.raises(InputError, match=sentence) as refused:
        examine(Fit(tmp_path / "turned.obj", picture=picture))
    assert len(read_image(picture)) == 44
    picture.unlink()
    # Found out once: the search for how a garment lies takes long.
    monkeypatch.setattr(examine_garment, "fit", Mock(side_effect=refused.value.__cause__))
    with pytest.raises(InputError, match="upside down"):
        examine(Fit(tmp_path / "turned.obj", picture=None))
    assert not picture.exists()


def test_a_garment_that_the_solver_cannot_move_is_shown_at_rest_and_the_reason_said(
    body: Body, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(examine_garment, "SIZE", (30, 44))
    monkeypatch.setattr(Physics, "unsupported_reason", lambda *_: "no hem holds it up")
    save_obj(fit_template("tops", body).mesh, tmp_path / "shirt.obj")
    picture = tmp_path / "fit.png"
    lines = examine(Fit(tmp_path / "shirt.obj", picture=picture))
    assert lines[-2] == "  not shown as cloth: no hem holds it up"
    assert len(read_image(picture)) == 44


def test_a_template_and_a_name_without_ending_are_told_from_files() -> None:
    with pytest.raises(InputError, match="tops: is a template, which fits every body"):
        examine(Fit(Path("tops"), picture=None))
    with pytest.raises(InputError, match=r"top: a garment file ends in \.obj, .* this name has no ending"):
        examine(Fit(Path("top"), picture=None))
