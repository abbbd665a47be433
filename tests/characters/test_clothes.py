"""Clothes that are taken off a character and worn on the body made of it."""

import base64
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from tests.characters.made_up import Piece, rewritten, write_character
from uvcloth.bodies.body import REGIONS, Body, load_body
from uvcloth.characters.parts import sort_parts
from uvcloth.characters.reader import read_character
from uvcloth.commands.body import MakeBody
from uvcloth.files.image import write_png
from uvcloth.formats.mesh_file import read_mesh
from uvcloth.garments.loading import load_garment
from uvcloth.geometry.authored import polygons_of


def pieces(body: Body) -> list[Piece]:
    """A body with a top of its own, a hand above the hips to the neck, in two meshes."""
    height = body.mesh.vertices[body.mesh.faces].mean(1)[:, 2]
    trunk = (body.regions == REGIONS.index("torso")) & (height > 0.05) & (height < 0.5)
    return [
        Piece("Body", "N00_Body_SKIN", body.mesh.faces),
        Piece("Body", "N00_Tops_CLOTH", body.mesh.faces[trunk], off=0.02),
    ]


def test_a_top_with_its_texture_is_taken_off_and_worn_again(
    body: Body, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_png(tmp_path / "red.png", torch.full((4, 4, 3), 200, dtype=torch.uint8).numpy())
    picture = base64.b64encode((tmp_path / "red.png").read_bytes()).decode()

    def textured(written: dict[str, Any]) -> None:
        written["images"] = [{"uri": f"data:image/png;base64,{picture}", "name": "red"}]
        written["textures"] = [{"source": 0}, {"extensions": {"KHR_texture_basisu": {"source": 1}}}]
        for material in written["materials"]:
            index = int(material["name"] == "Hair")
            material["pbrMetallicRoughness"]["baseColorTexture"] = {"index": index}

    path = tmp_path / "hero.glb"
    head = body.mesh.faces[body.regions == REGIONS.index("head")]
    write_character(path, body, [*pieces(body), Piece("Hair", "Hair", head, off=0.01)])
    rewritten(path, textured)
    MakeBody(out=tmp_path / "hero.npz", character=path, clothes=tmp_path / "clothes").run()
    written = tmp_path / "clothes" / "N00_Tops_CLOTH.obj"
    said = capsys.readouterr().out
    assert f"{written}: " in said
    assert said.count("  left out: textures in KTX2, which is not read") == 1
    hero = load_body(tmp_path / "hero.npz")
    worn = load_garment(str(written), hero)
    # The skin keeps its texture too, in the body's file and in what is written from it.
    MakeBody(out=tmp_path / "shown.glb", body=tmp_path / "hero.npz").run()
    shown = read_mesh(tmp_path / "shown.glb")
    for mesh, name in ((worn.mesh, "N00_Tops_CLOTH"), (shown, "N00_Body_SKIN")):
        material = polygons_of(mesh).materials[0]
        assert material.name == name
        assert material.texture is not None
        assert material.texture.content == (tmp_path / "red.png").read_bytes()
    centre, expected = worn.mesh.vertices.mean(0), body.mesh.vertices[pieces(body)[1].faces.unique()].mean(0)
    assert float((centre - expected).norm()) < 0.03


def test_a_character_without_clothes_becomes_a_body_and_the_report_says_so(
    body: Body, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "bare.glb"
    write_character(path, body, pieces(body)[:1])
    character = read_character(path)
    bare = SimpleNamespace(
        body=body,
        parts=sort_parts(character.parts, character.joints),
        rigged=SimpleNamespace(guessed=False),
        lines=list,
    )
    monkeypatch.setattr("uvcloth.commands.run.body.body_from_character", lambda *_: bare)
    MakeBody(out=tmp_path / "bare.npz", character=path, clothes=tmp_path / "clothes").run()
    said = capsys.readouterr().out
    assert "nothing is named as clothes" in said
    assert "--drop names them: N00_Body_SKIN" in said
    assert (tmp_path / "bare.npz").exists()
    assert not (tmp_path / "clothes").exists()
