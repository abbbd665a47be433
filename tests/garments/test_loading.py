"""Garments by name: templates, files, and files that would pass for templates."""

import shutil
from importlib.resources import files
from pathlib import Path

import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.loading import load_garment, load_garment_for_data
from uvcloth.garments.templates import fit_template

SKIRT = Path(str(files("uvcloth") / "data" / "garments" / "miniskirt.obj"))


def test_a_template_is_worn_and_a_file_is_fitted(body: Body) -> None:
    shirt = load_garment("tops", body)
    assert (shirt.name, shirt.template, shirt.source) == ("tops", "tops", "template")
    assert torch.equal(shirt.mesh.vertices, fit_template("tops", body).mesh.vertices)
    said: list[str] = []
    skirt = load_garment(str(SKIRT), body, said.append)
    assert (skirt.name, skirt.template, skirt.source) == ("miniskirt", "dress", "file")
    assert said[0].startswith(f"{SKIRT}: ")
    assert "worn as dress" in said[-1]


def test_a_name_that_is_neither_is_refused(body: Body) -> None:
    with pytest.raises(InputError, match=r"cape\.obj: no such file"):
        load_garment("cape.obj", body)


@pytest.mark.parametrize("stem", ["tops", "long_tops", "Tops"])
def test_a_file_may_not_pass_for_a_template_in_data(body: Body, tmp_path: Path, stem: str) -> None:
    copy = Path(shutil.copy(SKIRT, tmp_path / f"{stem}.obj"))
    assert load_garment(str(copy), body).name == stem
    with pytest.raises(InputError, match=rf"{stem}\.obj: .*mistaken for those of the template tops"):
        load_garment_for_data(str(copy), body)
    assert load_garment_for_data("tops", body).template == "tops"
