"""`uvcloth bake` and `uvcloth play`: what is written, shown and played."""

import json
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh

from tests.characters.made_up import rewritten
from tests.writers.glb_reader import GlbReader
from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin
from uvcloth.characters.body import CharacterBody
from uvcloth.commands.bake import Bake
from uvcloth.commands.play import Play
from uvcloth.commands.run.bake import bake
from uvcloth.errors import InputError
from uvcloth.garments.loading import load_outfit
from uvcloth.geometry.skinning import skin, strongest
from uvcloth.motion.library import load_clip
from uvcloth.motion.options import MotionOptions
from uvcloth.physics.surface import BodySurface
from uvcloth.player.baked import EXTENSION, open_baked
from uvcloth.player.outfit import Cloth, Outfit
from uvcloth.writers.animation import load_animation

SOME = MotionOptions(frames="20:32")
MILLIMETRE = 1e-3


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A skirt on the body of the package, which walks."""
    path = tmp_path_factory.mktemp("baked") / "skirt.glb"
    bake(Bake(("skirt",), path, motion="walk", quality="fast", options=SOME))
    return path


@pytest.fixture(scope="module")
def character_body(fitted: CharacterBody) -> Body:
    return fitted.body


@pytest.fixture(scope="module")
def hero(character: Path, fitted: CharacterBody) -> Path:
    """The character in two garments, walking."""
    path = character.with_name("baked.glb")
    command = Bake(("bottoms", "tops"), path, body=character, motion="walk", quality="fast", options=SOME)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("uvcloth.commands.run.wearer.body_from_character", lambda *_: fitted)
        bake(command)
    return path


def document_of(path: Path) -> dict[str, Any]:
    content = path.read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    return dict(json.loads(content[20 : 20 + length]))


def test_any_viewer_opens_the_file(own: Path, body: Body) -> None:
    assert own.stat().st_size - len(open_baked(own).content) < 1.3e6
    scene = trimesh.load(own, process=False)
    assert {"body", "skirt"} <= set(scene.geometry)
    glb = GlbReader.load(own)
    assert glb.gltf.extensionsUsed == [EXTENSION]
    assert not glb.gltf.extensionsRequired
    rest = glb.posed("body", None)[: len(body.mesh.vertices)]
    np.testing.assert_allclose(rest, body.mesh.vertices.numpy(), atol=0.05 * MILLIMETRE)
    clip = load_clip("walk", body, SOME)
    expected = posed_skin(body, clip.transforms())
    for frame in (0, 7):
        gap = np.linalg.norm(glb.posed("body", frame)[: len(rest)] - expected[frame].numpy(), axis=1)
        assert gap.mean() < 0.2 * MILLIMETRE  # Of the body's seven influences four are left.


def test_viewers_skin_the_garment_smoothly(own: Path, body: Body) -> None:
    (skirt,) = load_outfit(("skirt",), body)
    clip, glb, baked = load_clip("walk", body, SOME), GlbReader.load(own), open_baked(own)
    joints, weights = (torch.from_numpy(each) for each in strongest(skirt.smooth_weights, 4))
    kept = torch.zeros_like(skirt.smooth_weights).scatter_add(1, joints, weights)
    expected = skin(skirt.mesh.vertices, kept, clip.transforms()).numpy()
    (garment,) = baked.garments
    assert garment.size == len(skirt.mesh.vertices)
    for frame in (0, 7):
        gap = glb.posed("skirt", frame) - expected[frame][garment.vertices]
        assert np.abs(gap).max() < 0.05 * MILLIMETRE


def test_the_runtime_gets_the_joints_of_the_motion(own: Path, body: Body) -> None:
    baked = open_baked(own)
    assert baked.skin.names == body.skeleton.names
    clip = load_clip("walk", body, SOME)
    np.testing.assert_allclose(baked.motion().transforms, clip.transforms(torch.float64).numpy(), atol=5e-6)


def test_a_character_keeps_its_file(character: Path, hero: Path) -> None:
    before, after = document_of(character), document_of(hero)
    for name in ("meshes", "materials", "skins", "nodes"):
        assert after[name][: len(before[name])] == before[name]
    kept = GlbReader.load(character).read(0)
    np.testing.assert_array_equal(GlbReader.load(hero).read(0), kept)


def test_a_character_moves_its_own_joints(hero: Path, body: Body, character_body: Body) -> None:
    made = character_body
    clip, glb, baked = load_clip("walk", made, SOME), GlbReader.load(hero), open_baked(hero)
    names = [glb.gltf.nodes[node].name for node in baked.skin.nodes]
    assert names[0] == "mixamorig:Hips"
    assert baked.skin.names[0] == "Hips"
    assert len(set(names)) == len(names) < len(body.skeleton.names)
    moved = clip.transforms(torch.float64).numpy()[
        :, [made.skeleton.names.index(name) for name in baked.skin.names]
    ]
    np.testing.assert_allclose(baked.motion(fps=30.0).transforms, moved, atol=2e-5)
    # The surface that cloth collides with lies on the character's own, wherever that is posed.
    for frame in (0, 7):
        surface = BodySurface(posed_skin(made, clip.transforms())[frame], made.mesh.faces)
        shown = torch.from_numpy(glb.posed("Body", frame)).float()
        off = surface.closest(shown).signed_distance.abs()
        assert float(off.median()) < 2 * MILLIMETRE
        assert float(off.quantile(0.95)) < 10 * MILLIMETRE


def test_garments_of_a_character_lie_on_it(hero: Path) -> None:
    glb, baked = GlbReader.load(hero), open_baked(hero)
    assert [garment.name for garment in baked.garments] == ["bottoms", "tops"]
    outfit, motion = Outfit(baked.content), baked.motion(fps=30.0)
    baked.require_fit(outfit.joints, outfit.garments)
    cloth = Cloth(outfit)
    cloth.start(motion.transforms[7])
    for index, garment in enumerate(baked.garments):
        gap = glb.posed(garment.name, 7) - cloth.vertices(index)[garment.vertices]
        # Cloth hangs where skinning only follows.
        assert np.quantile(np.linalg.norm(gap, axis=1), 0.5) < 50 * MILLIMETRE


@pytest.mark.parametrize(
    ("who", "motion"),
    [
        ("hero", "kick"),
        pytest.param("own", None, marks=pytest.mark.thorough),
        pytest.param("own", "kick", marks=pytest.mark.thorough),
        pytest.param("hero", None, marks=pytest.mark.thorough),
    ],
)
def test_what_is_played_is_what_the_runtime_says(
    who: str, motion: str | None, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """By its own animation, and by another motion."""
    from uvcloth.commands.run.play import play

    path: Path = request.getfixturevalue(who)
    options = MotionOptions(frames="0:9")
    played = play(Play(path, tmp_path / "out.glb", motion, options))
    assert played.written == (tmp_path / "out.glb",)
    glb, baked = GlbReader.load(tmp_path / "out.glb"), open_baked(path)
    assert not glb.gltf.extensionsUsed
    assert len(glb.gltf.animations) == 1
    arrays = play(Play(path, tmp_path / "out.npz", motion, options))
    animation = load_animation(*arrays.written)
    assert played.frames == len(animation.vertices[0]) == 9
    for index, garment in enumerate(baked.garments):
        for frame in (0, 8):
            seen = glb.morphed(garment.name, glb.weights(garment.name, frame))
            expected = animation.vertices[index][frame][garment.vertices]
            np.testing.assert_allclose(seen, baked.in_scene(expected), atol=1e-5)
            normals = glb.morphed(garment.name, glb.weights(garment.name, frame), "NORMAL")
            np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-3)
    if motion is None:
        for frame in (0, 8):
            body = "body" if who == "own" else "Body"
            expected = GlbReader.load(path).posed(body, frame)
            np.testing.assert_allclose(glb.posed(body, frame), expected, atol=1e-5)
    np.testing.assert_allclose(glb.times(), np.arange(9) / 30.0, atol=1e-6)


def test_another_motion_is_retargeted_as_on_the_body(hero: Path, character_body: Body) -> None:
    from uvcloth.commands.run.play_motion import retargeted

    made = character_body
    baked = open_baked(hero)
    motion, clip = retargeted(baked, "kick", SOME), load_clip("kick", made, SOME)
    rows = [made.skeleton.names.index(name) for name in baked.skin.names]
    expected = clip.transforms(torch.float64).numpy()[:, rows]
    # The floor is found by the surface, which the file does not have.
    rise = (motion.transforms - expected)[..., 2, 3].mean()
    assert abs(rise) < 5 * MILLIMETRE
    expected[..., 2, 3] += rise
    np.testing.assert_allclose(motion.transforms, expected, atol=2e-3)


def test_wind_and_fabrics_move_what_is_played(own: Path, tmp_path: Path) -> None:
    from uvcloth.commands.run.play import play

    played = {}
    calm = Play(own, tmp_path / "calm.npz")
    for command in (
        calm,
        replace(calm, out=tmp_path / "as baked.npz", fabric=("jersey",)),
        replace(calm, out=tmp_path / "wind.npz", wind=(0.0, 9.0, 0.0)),
        replace(calm, out=tmp_path / "heavy.npz", fabric=("denim",)),
    ):
        play(command)
        with np.load(command.out) as arrays:
            played[command.out.stem] = arrays["skirt_vertices"]
    np.testing.assert_array_equal(played["as baked"], played["calm"])
    assert (played["wind"] - played["calm"])[-1, :, 1].mean() > 20 * MILLIMETRE
    assert np.abs(played["heavy"] - played["calm"]).max() > 2 * MILLIMETRE


def test_playing_needs_no_torch(own: Path, tmp_path: Path) -> None:
    code = (
        "import sys\n"
        "from uvcloth import cli\n"
        f"sys.argv = ['uvcloth', 'play', {str(own)!r}, '--out', {str(tmp_path / 'out.glb')!r}]\n"
        "assert cli.main() == 0\n"
        "print([name for name in ('torch', 'scipy', 'numba', 'warp', 'trimesh') if name in sys.modules])"
    )
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, cwd=root)
    assert done.stdout.splitlines()[-1] == "[]"
    assert GlbReader.load(tmp_path / "out.glb").mesh("skirt").weights == [0.0] * 12


def no_animation(written: dict[str, Any]) -> None:
    del written["animations"]


def no_cloth(written: dict[str, Any]) -> None:
    del written["extensions"]


def other_cloth(written: dict[str, Any]) -> None:
    written["extensions"][EXTENSION]["bufferView"] = 0


def no_fabric(written: dict[str, Any]) -> None:
    del written["extensions"][EXTENSION]["garments"][0]["fabric"]


def test_what_cannot_be_played_says_why_and_leaves_nothing(own: Path, tmp_path: Path) -> None:
    from uvcloth.commands.run.play import play

    path, out = tmp_path / "worn.glb", tmp_path / "out.glb"

    def changed(change: Callable[[dict[str, Any]], None]) -> Path:
        shutil.copy(own, path)
        return rewritten(path, change)

    with pytest.raises(InputError, match=r"worn\.glb: has no animation of its skeleton"):
        play(Play(changed(no_animation), out))
    with pytest.raises(InputError, match=r"worn\.glb: these bytes are no baked outfit"):
        play(Play(changed(other_cloth), out))
    with pytest.raises(InputError, match=r"worn\.glb: has no cloth to play"):
        play(Play(changed(no_cloth), out))
    with pytest.raises(InputError, match=r"worn\.glb: the file does not say of which fabric skirt was baked"):
        play(Play(changed(no_fabric), out, fabric=("silk",)))
    with pytest.raises(InputError, match="wind of more than 100 m/s"):
        play(Play(own, out, wind=(300.0, 0.0, 0.0)))
    with pytest.raises(InputError, match=r"skirt\.glb: --animation jump: expected one of 1 "):
        play(Play(own, out, options=MotionOptions(animation="jump")))
    with pytest.raises(InputError, match="--in-place need --motion"):
        Play(own, out, options=MotionOptions(in_place=True)).run()
    whole = own.read_bytes()
    path.write_bytes(whole[:-1000])
    with pytest.raises(InputError, match=r"worn\.glb: not a complete glTF file"):
        play(Play(path, out))
    path.write_bytes(whole.replace(b"cages.rest\0", b"cages.tset\0"))
    with pytest.raises(InputError, match=r"worn\.glb: the outfit is cut or damaged"):
        play(Play(path, out))
    assert [path.name for path in tmp_path.iterdir()] == ["worn.glb"]


def test_what_cannot_be_baked_says_why_and_leaves_nothing(
    tmp_path: Path, body: Body, monkeypatch: pytest.MonkeyPatch
) -> None:
    def torn(*_: object) -> bytes:
        raise InputError("garment dress: is torn")

    command = Bake(("dress",), tmp_path / "out.glb")
    with monkeypatch.context() as changed:
        changed.setattr("uvcloth.commands.run.bake.bake_outfit", torn)
        with pytest.raises(InputError, match="garment dress: is torn"):
            bake(command)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.4)
    ball.vertices += body.skeleton.heads[0].numpy()
    ball.export(tmp_path / "ball.obj")
    with pytest.raises(InputError, match="ball"):
        bake(replace(command, garment=(str(tmp_path / "ball.obj"),)))
    assert not (tmp_path / "out.glb").exists()
