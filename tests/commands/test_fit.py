"""The fit command: what it prints, and the picture that it draws, also of a garment that it refuses."""

from pathlib import Path

import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.commands import fit as command
from uvcloth.errors import InputError
from uvcloth.export.obj import save_obj
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import Mesh


def test_a_picture_shows_what_is_worn_and_what_is_refused(
    body: Body, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "SIZE", (30, 44))
    shirt = fit_template("tops", body).mesh
    save_obj(shirt, tmp_path / "shirt.obj")
    picture = tmp_path / "fit.png"
    options = {"body_file": None, "template": None, "out": None}
    lines = command.examine(tmp_path / "shirt.obj", picture=picture, **options)
    assert lines[-2:] == ["  worn as tops", str(picture)]
    worn = picture.read_bytes()
    assert worn.startswith(b"\x89PNG")
    centre = (shirt.vertices.amax(0) + shirt.vertices.amin(0)) / 2
    turned = (shirt.vertices - centre) * torch.tensor([-1.0, 1.0, -1.0]) + centre
    save_obj(Mesh(turned, shirt.faces, shirt.uvs, shirt.face_uvs), tmp_path / "turned.obj")
    with pytest.raises(InputError, match=r"turned\.obj: the garment lies upside down: .*fit\.png shows it"):
        command.examine(tmp_path / "turned.obj", picture=picture, **options)
    assert picture.read_bytes() != worn
    picture.unlink()
    with pytest.raises(InputError, match="upside down"):
        command.examine(tmp_path / "turned.obj", picture=None, **options)
    assert not picture.exists()


def test_a_template_and_a_name_without_ending_are_told_from_files() -> None:
    options = {"body_file": None, "template": None, "out": None, "picture": None}
    with pytest.raises(InputError, match="tops: is a template, which fits every body"):
        command.examine(Path("tops"), **options)
    with pytest.raises(InputError, match=r"top: a garment file ends in \.obj, .* this name has no ending"):
        command.examine(Path("top"), **options)
