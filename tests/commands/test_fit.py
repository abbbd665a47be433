"""The fit command: what it prints, and the picture that it draws, also of a garment that it refuses."""

from pathlib import Path

import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.commands import examine_garment
from uvcloth.commands.examine_garment import examine
from uvcloth.commands.fit import Fit
from uvcloth.errors import InputError
from uvcloth.export.obj import save_obj
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.mesh import Mesh


def test_a_picture_shows_what_is_worn_and_what_is_refused(
    body: Body, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(examine_garment, "SIZE", (30, 44))
    shirt = fit_template("tops", body).mesh
    save_obj(shirt, tmp_path / "shirt.obj")
    picture = tmp_path / "fit.png"
    lines = examine(Fit(tmp_path / "shirt.obj", picture=picture))
    assert lines[-2:] == ["  worn as tops", str(picture)]
    worn = picture.read_bytes()
    assert worn.startswith(b"\x89PNG")
    centre = (shirt.vertices.amax(0) + shirt.vertices.amin(0)) / 2
    turned = (shirt.vertices - centre) * torch.tensor([-1.0, 1.0, -1.0]) + centre
    save_obj(Mesh(turned, shirt.faces, shirt.uvs, shirt.face_uvs), tmp_path / "turned.obj")
    with pytest.raises(InputError, match=r"turned\.obj: the garment lies upside down: .*fit\.png shows it"):
        examine(Fit(tmp_path / "turned.obj", picture=picture))
    assert picture.read_bytes() != worn
    picture.unlink()
    with pytest.raises(InputError, match="upside down"):
        examine(Fit(tmp_path / "turned.obj", picture=None))
    assert not picture.exists()


def test_a_template_and_a_name_without_ending_are_told_from_files() -> None:
    with pytest.raises(InputError, match="tops: is a template, which fits every body"):
        examine(Fit(Path("tops"), picture=None))
    with pytest.raises(InputError, match=r"top: a garment file ends in \.obj, .* this name has no ending"):
        examine(Fit(Path("top"), picture=None))
