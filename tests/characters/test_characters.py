"""Characters as bodies: what is read is what was written, and our surface and garments fit them."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO
import pytest
import torch

from tests.characters.made_up import MIXAMO, Piece, rewritten, t_posed, vrm_table, with_box, write_character
from tests.motion.test_gltf import CESIUM_MAN, CESIUM_ROLES
from tests.writers.glb_reader import GlbReader
from uvcloth.bodies.body import REGIONS, Body, load_body, save_body
from uvcloth.bodies.visible import visible_body
from uvcloth.characters.body import CharacterBody, body_from_character, region_vertices
from uvcloth.characters.enclosed import without_enclosed
from uvcloth.characters.parts import label, sort_parts
from uvcloth.characters.props import split_props
from uvcloth.characters.reader import Part, read_character
from uvcloth.characters.rig import rig_character
from uvcloth.characters.shape import SkinnedSurface
from uvcloth.commands.body import MakeBody, Phenotype
from uvcloth.commands.run.body import make
from uvcloth.errors import InputError
from uvcloth.garments.templates import load_template, tailored
from uvcloth.geometry.mesh import Mesh, vertex_normals
from uvcloth.motion.library import load_clip
from uvcloth.physics.surface import BodySurface
from uvcloth.writers.writer import open_writer

STRETCH = torch.tensor([0.9, 1.05, 1.12])


def pieces(body: Body) -> list[Piece]:
    """Head and trunk as two meshes, hair on the head, a shirt over the skin."""
    on_head, on_trunk = (body.regions == REGIONS.index(region) for region in ("head", "torso"))
    faces = body.mesh.faces
    return [
        Piece("Face", "N00_Face_SKIN", faces[on_head]),
        Piece("Body", "N00_Body_SKIN", faces[~on_head]),
        Piece("Hair", "N00_HAIR", faces[on_head], off=0.02),
        Piece("Body", "N00_Tops_CLOTH", faces[on_trunk], off=0.015),
    ]


def stretched(body: Body) -> Body:
    mesh = replace(body.mesh, vertices=body.mesh.vertices * STRETCH)
    return replace(body, mesh=mesh, skeleton=replace(body.skeleton, heads=body.skeleton.heads * STRETCH))


@pytest.fixture(scope="module")
def character(body: Body, tmp_path_factory: pytest.TempPathFactory) -> CharacterBody:
    """A longer, narrower body than ours with a pack, Mixamo's names, in centimetres, Z up, in two meshes."""
    path = tmp_path_factory.mktemp("character") / "longer.glb"
    packed = with_box(stretched(body), "Spine1", centre=(0.0, 0.18, 0.5), size=(0.32, 0.2, 0.45))
    face, skin, hair, clothing = pieces(body)
    pack = packed.mesh.faces[len(body.mesh.faces) :]
    skin, hair = replace(skin, faces=torch.cat([skin.faces, pack])), replace(hair, textured=False)
    write_character(path, packed, [face, skin, hair, clothing])
    return body_from_character(path, body)


def test_names_axes_unit_and_pose_of_a_file_do_not_matter(body: Body, tmp_path: Path) -> None:
    write_character(tmp_path / "t.glb", t_posed(body), pieces(body)[:2])
    character = read_character(tmp_path / "t.glb")
    rigged = rig_character(character, {}, body)
    assert rigged.unit == "m"
    assert 35 < rigged.turned < 45
    off = (rigged.skeleton.heads - body.skeleton.heads).norm(dim=1)
    known = {body.skeleton.roles[role] for role in rigged.roles}
    assert float(off[list(known)].max()) < 2e-3
    # Joints that the file's names do not tell lie as in our body.
    assert float(off.max()) < 0.02
    trunk = body.mesh.faces[body.regions != REGIONS.index("head")].unique()
    gap = torch.zeros(len(body.mesh.vertices))
    gap[trunk] = (rigged.parts[1].mesh.vertices - body.mesh.vertices[trunk]).norm(dim=1)
    assert float(gap[region_vertices(body, ("thigh", "calf", "foot"))].max()) < 1e-4
    assert float(gap[region_vertices(body, ("torso",))].quantile(0.95)) < 0.01
    # Nothing tells how far an arm is twisted about itself between the two poses.
    assert float(gap[region_vertices(body, ("upper_arm", "forearm"))].max()) < 0.03
    legs = body.weights[trunk][:, body.skeleton.names.index("LeftLeg")]
    own = rigged.parts[1].weights[:, body.skeleton.names.index("LeftLeg")]
    torch.testing.assert_close(own, legs, atol=0.03, rtol=0)


@pytest.mark.parametrize("version", ["VRM", "VRMC_vrm"])
def test_the_table_of_a_vrm_file_goes_before_names(body: Body, tmp_path: Path, version: str) -> None:
    path = tmp_path / "hero.vrm"
    sides = {"Left": "Right", "Right": "Left"}
    swapped = {name: re.sub("Left|Right", lambda side: sides[side[0]], name) for name in body.skeleton.names}
    write_character(path, body, pieces(body)[:2], names=swapped)
    rewritten(path, vrm_table(version, swapped))
    rigged = rig_character(read_character(path), {}, body)
    assert rigged.roles["left_shin"] == "RightLeg"
    joints = body.skeleton.roles
    off = (rigged.skeleton.heads - body.skeleton.heads)[[joints[role] for role in rigged.roles]]
    assert float(off.norm(dim=1).max()) < 2e-3


@pytest.mark.parametrize("version", ["VRM", "VRMC_vrm"])
def test_what_hangs_from_spring_bones_is_clothes(body: Body, tmp_path: Path, version: str) -> None:
    path = tmp_path / "hero.vrm"
    legs, head = (torch.isin(body.regions, torch.tensor([REGIONS.index(each)])) for each in ("calf", "head"))
    parts = [Piece("One", "Skin", body.mesh.faces), Piece("Two", "", body.mesh.faces[legs], off=0.02)]
    names = {name: name for name in body.skeleton.names}
    write_character(path, body, [*parts, Piece("Hair", "", body.mesh.faces[head], off=0.02)], names=names)
    rewritten(path, vrm_table(version, names))

    def springs(written: dict[str, Any]) -> None:
        nodes = [node.get("name", "") for node in written["nodes"]]
        roots = [nodes.index(name) for name in ("LeftLeg", "RightLeg", "Head")]
        if version == "VRM":
            written["extensions"]["VRM"]["secondaryAnimation"] = {"boneGroups": [{"bones": roots}]}
        else:
            joints = [{"node": root} for root in roots]
            written["extensions"]["VRMC_springBone"] = {"springs": [{"joints": joints}]}

    character = read_character(rewritten(path, springs))
    skin, skirt, hair = (part.spring_share for part in character.parts)
    assert 0.0 < skin < 0.25
    assert skirt > 0.9
    assert hair == 0.0
    rigged = rig_character(character, {}, body)
    found = sort_parts(rigged.parts, rigged.skeleton.names)
    assert [part.name for part in found.left_out] == ["Two"]
    assert any("hangs from spring bones, --clothes" in line for line in found.lines())


def test_joints_without_names_are_told_by_their_places(body: Body, tmp_path: Path) -> None:
    path = tmp_path / "nameless.glb"
    names = {name: f"bone {joint}" for joint, name in enumerate(body.skeleton.names)}
    write_character(path, body, pieces(body)[:2], names=names)
    rigged = rig_character(read_character(path), {}, body)
    assert rigged.guessed
    hands = [body.skeleton.names.index(f"{side}Hand") for side in ("Left", "Right")]
    torch.testing.assert_close(rigged.skeleton.heads[hands], body.skeleton.heads[hands], atol=2e-3, rtol=0)


def test_a_neck_without_joints_is_where_ours_is(body: Body, tmp_path: Path) -> None:
    path = tmp_path / "neckless.glb"
    write_character(path, body, pieces(body)[:2], names=MIXAMO | {"Neck": "mixamorig:Plate"})
    rigged = rig_character(read_character(path), {}, body)
    assert "lower_neck" not in rigged.roles
    necks = [body.skeleton.names.index(name) for name in ("Neck", "Neck1")]
    gap = (rigged.skeleton.heads - body.skeleton.heads)[necks].norm(dim=1)
    assert float(gap.max()) < 0.03


def test_hair_is_only_seen_and_clothes_over_skin_go(body: Body, tmp_path: Path) -> None:
    write_character(tmp_path / "dressed.glb", body, pieces(body))
    rigged = rig_character(read_character(tmp_path / "dressed.glb"), {}, body)

    def fates(keep: tuple[str, ...] = (), drop: tuple[str, ...] = ()) -> list[list[str]]:
        found = sort_parts(rigged.parts, rigged.skeleton.names, keep, drop)
        return [[label(part) for part in each] for each in (found.surface, found.visible, found.left_out)]

    face, skin, hair, shirt = (label(part) for part in rigged.parts)
    assert fates() == [[face, skin], [hair], [shirt]]
    assert fates(keep=("N00_Tops_CLOTH",), drop=("Hair",)) == [[face, skin, shirt], [], [hair]]
    # Without skin beneath them clothes are what cloth lies on.
    assert fates(drop=("N00_Body_SKIN",)) == [[face, shirt], [hair], [skin]]
    with pytest.raises(InputError, match=r"--keep Hare: .* no mesh .* did you mean Hair"):
        fates(keep=("Hare",))


def test_shoes_stay_where_no_feet_are_in_them(body: Body) -> None:
    """MakeHuman takes the skin beneath clothes away; its clothes are named male_casualsuit01, shoes06."""
    feet = body.mesh.faces[body.regions == REGIONS.index("foot")]
    others = body.mesh.faces[body.regions != REGIONS.index("foot")]

    def part(name: str, faces: torch.Tensor) -> Part:
        return Part(name, "", replace(body.mesh, faces=faces, face_uvs=faces), body.weights)

    suit, shoes = part("male_casualsuit01Mesh", others), part("shoes06Mesh", feet)
    barefoot, footless = part("genericMesh", body.mesh.faces), part("genericMesh", others)
    names = body.skeleton.names
    assert sort_parts([barefoot, suit, shoes], names).left_out == (suit, shoes)
    found = sort_parts([footless, suit, shoes], names)
    assert (found.left_out, found.surface) == ((suit,), (footless, shoes))


def test_what_is_inside_a_character_does_not_draw_our_surface_in(body: Body) -> None:
    """Ball joints inside the shell of a mannequin; armpits and the skin between the legs are not inside."""
    filled = with_box(body, "Spine1", centre=(0.0, -0.05, 0.4), size=(0.12, 0.06, 0.12))
    kept = without_enclosed(SkinnedSurface(filled.mesh.vertices, filled.mesh.faces, filled.weights)).faces
    inside = (kept >= len(body.mesh.vertices)).any(1)
    assert not inside.any()
    known = {tuple(face) for face in kept.tolist()}
    lost = torch.tensor([tuple(face) not in known for face in body.mesh.faces.tolist()])
    clothed = torch.isin(
        body.regions, torch.tensor([REGIONS.index(each) for each in ("torso", "upper_arm", "thigh", "calf")])
    )
    assert float(lost[clothed].float().mean()) < 0.005


def test_what_no_bone_sees_first_is_a_prop(body: Body) -> None:
    part = Part("hero", "", replace(body.mesh, uvs=torch.zeros(0, 2)), body.weights)
    half = body.mesh.faces[body.mesh.vertices[body.mesh.faces].mean(1)[:, 1] > 0.0]

    def faces(parts: tuple[Part, ...]) -> list[int]:
        return [len(each.mesh.faces) for each in parts]

    pack = with_box(body, "Spine1", centre=(0.0, 0.18, 0.5), size=(0.32, 0.2, 0.45))
    skin, props = split_props([Part("hero", "", pack.mesh, pack.weights)], body.skeleton)
    assert faces(skin) == faces((part,))
    assert faces(props) == [768]
    assert float(props[0].weights[:, body.skeleton.names.index("Spine1")].min()) == 1.0
    # What wraps a bone is something that cloth lies on, like the skin below.
    on_trunk = body.mesh.faces[body.regions == REGIONS.index("torso")]
    wider = body.mesh.vertices * torch.tensor([1.1, 1.15, 1.0])
    vest = Part("vest", "", Mesh(wider, on_trunk, torch.zeros(0, 2), on_trunk), body.weights)
    assert split_props([part, vest], body.skeleton)[0][-1].name == "vest"
    # A back and a front that are not joined are skin, both; so is a coat where there is no skin beneath it.
    back = replace(part, name="back", mesh=replace(part.mesh, faces=half, face_uvs=half))
    rest = body.mesh.faces[body.mesh.vertices[body.mesh.faces].mean(1)[:, 1] <= 0.0]
    front = replace(part, name="front", mesh=replace(part.mesh, faces=rest, face_uvs=rest))
    moved = replace(
        back, mesh=replace(back.mesh, vertices=back.mesh.vertices + torch.tensor([0.0, 0.01, 0.0]))
    )
    skin, props = split_props([front, moved], body.skeleton)
    assert {part.name for part in skin} == {"front", "back"}
    assert sum(faces(props)) < 0.02 * len(body.mesh.faces)


def test_our_surface_takes_the_shape_of_a_character(body: Body, character: CharacterBody) -> None:
    clothed = region_vertices(body, ("torso", "upper_arm", "forearm", "thigh", "calf"))
    near = character.off[clothed]
    assert float(near.median()) < 0.002
    assert float(near.quantile(0.95)) < 0.005
    # The character is our own body stretched, its limbs turned a little: vertices keep their places.
    trunk = region_vertices(body, ("torso",))
    legs = [body.skeleton.names.index(name) for name in ("LeftUpLeg", "RightUpLeg")]
    truth = stretched(body)
    truth_at = truth.mesh.vertices - truth.skeleton.heads[legs].mean(0) + body.skeleton.heads[legs].mean(0)
    gap = (character.body.mesh.vertices - truth_at)[trunk].norm(dim=1)
    assert float(gap.median()) < 0.012
    weights = (character.body.weights - body.weights)[trunk].abs().sum(1)
    assert float(weights.median()) < 0.2


def test_templates_lie_on_a_character_as_on_our_body(body: Body, character: CharacterBody) -> None:
    ours, theirs = (BodySurface(each.mesh.vertices, each.mesh.faces) for each in (body, character.body))
    for name in ("tops", "bottoms", "dress"):
        template = load_template(name)
        before = ours.closest(tailored(template, body).vertices).signed_distance
        after = theirs.closest(tailored(template, character.body).vertices).signed_distance
        assert float(after.min()) > 0
        tight = before < 0.03
        ratio = after[tight] / before[tight]
        assert 0.7 < float(ratio.median()) < 1.3
        assert float(((ratio > 0.7) & (ratio < 1.3)).float().mean()) > 0.6


def test_a_character_is_kept_and_seen(character: CharacterBody, tmp_path: Path) -> None:
    save_body(character.body, tmp_path / "c.npz")
    body = load_body(tmp_path / "c.npz")
    shown = visible_body(body)
    parts = character.parts
    faces = sum(len(part.mesh.faces) for part in (*parts.surface, *parts.props, *parts.visible))
    assert [len(part.mesh.faces) for part in parts.props if label(part) == "Body (N00_Body_SKIN)"] == [768]
    assert len(shown.mesh.faces) == len(shown.regions) == faces
    assert not len(parts.visible[0].mesh.uvs)
    assert shown.mesh.face_uvs.shape == shown.mesh.faces.shape
    assert len(shown.mesh.uvs[shown.mesh.face_uvs[-len(parts.visible[0].mesh.faces) :]].unique()) > 1000
    clip = load_clip("walk", body).window(0, 1)
    garment = tailored(load_template("tops"), body)
    with open_writer(tmp_path / "c.glb", [("tops", garment)], body, clip.fps) as writer:
        writer.add([garment.vertices], clip.transforms()[0])
    glb = GlbReader.load(tmp_path / "c.glb")
    primitives = glb.gltf.meshes[glb.gltf.nodes[glb.node("body")].mesh].primitives
    assert sum(glb.gltf.accessors[each.indices].count for each in primitives) == 3 * faces
    named = {glb.gltf.materials[each.material].name for each in primitives}
    assert named == {part.material for part in (*parts.surface, *parts.props, *parts.visible)}


def test_characters_that_cannot_be_dressed_are_refused(body: Body, tmp_path: Path) -> None:
    path = tmp_path / "odd.glb"
    write_character(path, body, pieces(body)[:2], skinned=False)
    with pytest.raises(InputError, match=r"odd\.glb: has no skin"):
        body_from_character(path, body)
    names = MIXAMO | {"LeftHand": "claw", "RightLeg": "stilt"}
    bent = body.skeleton.heads.clone()
    bent[body.skeleton.names.index("RightLeg") :] += torch.tensor([0.0, -0.4, 0.3])
    lame = replace(body, skeleton=replace(body.skeleton, heads=bent))
    write_character(path, lame, pieces(body)[:2], names=names)
    with pytest.raises(
        InputError,
        match=r"odd\.glb: no joint of the character is the .*right shin.*left hand|left hand.*right shin",
    ):
        body_from_character(path, body)
    heads = body.skeleton.heads * torch.tensor([1.0, 1.0, 0.6])
    crouched = replace(body, skeleton=replace(body.skeleton, heads=heads))
    write_character(path, crouched, [Piece("Body", "skin", body.mesh.faces)])
    with pytest.raises(
        InputError,
        match=r"odd\.glb: .* of the torso stands more than .*; .*character\.png shows what was taken",
    ):
        make(MakeBody(tmp_path / "b.npz", character=path))
    picture = OpenImageIO.ImageInput.open(str(tmp_path / "character.png")).read_image(format="uint8")
    assert len(np.unique(picture.reshape(-1, picture.shape[-1]), axis=0)) > 1000
    with pytest.raises(InputError, match=r"odd\.obj: expected a character as \.glb"):
        body_from_character(tmp_path / "odd.obj", body)
    with pytest.raises(InputError, match=r"odd\.glb: has its own shape"):
        make(MakeBody(tmp_path / "b.npz", character=path, phenotype=Phenotype(height=0.5)))


def test_our_shape_stands_in_where_skin_was_taken_away(body: Body, tmp_path: Path) -> None:
    """As MakeHuman and VRoid Studio do beneath clothes, which may be the garment to dress."""
    path, covered = tmp_path / "cut.glb", body.regions == REGIONS.index("torso")
    write_character(path, body, [Piece("Body", "skin", body.mesh.faces[~covered])])
    cut = body_from_character(path, body)
    assert any("of the torso has nothing of the character near it" in line for line in cut.lines())
    torso = region_vertices(body, ("torso",))
    assert float((cut.body.mesh.vertices - body.mesh.vertices)[torso].norm(dim=1).max()) < 0.015


def test_a_skirt_over_bare_legs_is_left_out_though_a_shirt_is_skin(body: Body) -> None:
    torso, thigh = (body.regions == REGIONS.index(region) for region in ("torso", "thigh"))
    faces = body.mesh.faces

    def part(material: str, shown: torch.Tensor, off: float = 0.0) -> Part:
        vertices = body.mesh.vertices + off * vertex_normals(body.mesh.vertices, faces)
        return Part(
            "hero", material, Mesh(vertices, faces[shown], torch.zeros(0, 2), faces[shown]), body.weights
        )

    skin, shirt, skirt = part("skin", ~torso), part("tops", torso, 0.01), part("skirt", thigh, 0.05)
    sorted_parts = sort_parts([skin, shirt, skirt], body.skeleton.names)
    assert sorted_parts.surface == (skin, shirt)
    assert sorted_parts.left_out == (skirt,)


@pytest.mark.skipif(not CESIUM_MAN.is_file(), reason=f"no {CESIUM_MAN}")
def test_a_character_with_a_large_head_is_dressed(body: Body, tmp_path: Path) -> None:
    (tmp_path / "map.json").write_text(json.dumps(CESIUM_ROLES))
    man = make(MakeBody(tmp_path / "man.npz", character=CESIUM_MAN, joints=tmp_path / "map.json"))
    assert 1.4 < float(man.mesh.vertices[:, 2].max() - man.mesh.vertices[:, 2].min()) < 1.6
    surface = BodySurface(man.mesh.vertices, man.mesh.faces)
    own = visible_body(man).mesh
    clothed = torch.isin(
        man.regions[surface.closest(own.vertices).faces.clamp(min=0)],
        torch.tensor([REGIONS.index(region) for region in ("torso", "upper_arm", "thigh", "calf")]),
    )
    above = surface.closest(own.vertices[clothed]).signed_distance
    assert float(above.max()) < 0.002
    for name in ("tops", "bottoms"):
        cloth = tailored(load_template(name), man).vertices
        assert float(surface.closest(cloth).signed_distance.min()) > 0
