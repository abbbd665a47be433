"""A baked T-shirt with wrinkles: as a rollout shows it, wherever the body is, and as before without them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin
from uvcloth.commands.bake import Bake
from uvcloth.commands.play import Play
from uvcloth.commands.run.bake import bake
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit as WornOutfit
from uvcloth.garments.templates import fit_template
from uvcloth.motion.options import MotionOptions
from uvcloth.player.baked import BakedFile, open_baked
from uvcloth.player.outfit import Cloth, Outfit
from uvcloth.player.sections import pack, unpack
from uvcloth.wrinkles.model import load_wrinkles, shipped_for
from uvcloth.wrinkles.outfit import WrinkledOutfit

FPS = 30.0
Change = Callable[[NDArray[np.int64]], NDArray[np.int64]]
MILLIMETRE = 1e-3


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A T-shirt on the body of the package, which walks."""
    path = tmp_path_factory.mktemp("baked") / "shirt.glb"
    bake(Bake(("tops",), path, motion="walk", wrinkles=True, options=MotionOptions(frames="20:32")))
    return path


@pytest.fixture(scope="module")
def baked(path: Path) -> BakedFile:
    return open_baked(path)


@pytest.fixture(scope="module")
def joints(baked: BakedFile) -> NDArray[np.float64]:
    return baked.motion(fps=FPS).transforms


@pytest.fixture(scope="module")
def plain(baked: BakedFile) -> Outfit:
    """The same outfit without the sections of wrinkles."""
    sections, steps = unpack(baked.content)
    left = {name: array for name, array in sections.items() if not name.startswith("wrinkles")}
    return Outfit(pack(left, {name: step for name, step in steps.items() if name in left}))


def played(outfit: Outfit, joints: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Vertices of the garment in each frame."""
    cloth, frames = Cloth(outfit), []
    cloth.start(joints[0])
    for transforms in joints:
        cloth.step(transforms, 1.0 / FPS)
        frames.append(cloth.vertices(0))
    return frames


def test_what_is_played_is_what_a_rollout_shows(
    baked: BakedFile, plain: Outfit, joints: NDArray[np.float64], body: Body
) -> None:
    """Within the rounding of the network, 0.1 mm; folds have millimetres."""
    shirt = fit_template("tops", body)
    outfit = WornOutfit(body, (shirt,))
    shown = WrinkledOutfit(load_wrinkles(shipped_for(outfit)), outfit, [shirt.mesh], "default")
    posed = posed_skin(body, torch.from_numpy(joints)).float()
    frames = zip(played(Outfit(baked.content), joints), played(plain, joints), posed, strict=True)
    for index, (wrinkled, smooth, skin) in enumerate(frames):
        (expected,) = shown.shown((torch.from_numpy(smooth).float(),), skin, FPS)
        apart = np.linalg.norm(wrinkled - expected.numpy(), axis=1) / MILLIMETRE
        assert apart.mean() < 0.05, index
        assert np.quantile(apart, 0.999) < 0.5, index
    kept = len(smooth)
    assert 1.0 < np.linalg.norm(wrinkled[:kept] - smooth, axis=1).mean() / MILLIMETRE < 10.0


def test_the_mesh_of_the_file_is_the_finer_one(baked: BakedFile, path: Path, tmp_path: Path) -> None:
    (garment,) = baked.garments
    outfit = Outfit(baked.content)
    assert outfit.garments == (garment.size,)
    baked.require_fit(outfit.joints, outfit.garments)
    Play(path, tmp_path / "played.glb").run()
    assert (tmp_path / "played.glb").stat().st_size > path.stat().st_size
    assert len(baked.content) < 1.4e6


def test_a_scene_elsewhere_has_the_same_wrinkles(baked: BakedFile, joints: NDArray[np.float64]) -> None:
    outfit = Outfit(baked.content)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    there = turn @ joints
    there[..., 3] += (30.0, -20.0, 1.0)
    here = played(outfit, joints[:4])
    for expected, vertices in zip(here, played(outfit, there[:4]), strict=True):
        apart = np.linalg.norm((vertices - (30.0, -20.0, 1.0)) @ turn - expected, axis=1)
        assert apart.max() < 0.1 * MILLIMETRE


def test_what_was_saved_goes_on(baked: BakedFile, joints: NDArray[np.float64]) -> None:
    cloth = Cloth(Outfit(baked.content))
    cloth.start(joints[0])
    for transforms in joints[:3]:
        cloth.step(transforms, 1.0 / FPS)
    state = cloth.save()
    cloth.step(joints[3], 1.0 / FPS)
    expected, other = cloth.vertices(0), Cloth(cloth.outfit)
    other.restore(state)
    other.step(joints[3], 1.0 / FPS)
    np.testing.assert_array_equal(other.vertices(0), expected)
    wrong = state.copy()
    wrong[-12 * cloth.outfit.garments[0] :] = 255
    with pytest.raises(ValueError, match="the bytes are not those of cloth in this outfit"):
        cloth.restore(wrong)


def test_folds_begin_anew_where_the_body_jumps(baked: BakedFile, joints: NDArray[np.float64]) -> None:
    there = joints[2].copy()
    there[..., 3] += (50.0, 0.0, 0.0)
    frames = played(Outfit(baked.content), np.stack([*joints[:2], there]))
    size = np.linalg.norm(frames[2] - (50.0, 0.0, 0.0) - frames[1], axis=1)
    assert size.max() < 0.1


def test_options_that_do_not_go_together_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--wrinkles-from: goes with --wrinkles"):
        Bake(("tops",), tmp_path / "shirt.glb", wrinkles_from=tmp_path).run()


def test_other_garments_stay_plain_and_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bake(Bake(("skirt",), tmp_path / "skirt.glb", wrinkles=True))
    assert (
        "garment skirt: wrinkles are trained for tops, not skirt: it stays plain" in capsys.readouterr().err
    )
    assert "wrinkles.garments" not in unpack(open_baked(tmp_path / "skirt.glb").content)[0]


@pytest.mark.parametrize(
    ("name", "change", "sentence"),
    [
        ("wrinkles.shape", lambda a: a + 1, "the network of wrinkles has no size or channels that can be"),
        ("wrinkles.shape", lambda a: a[:1], "the network of wrinkles has no size or channels that can be"),
        ("wrinkles.weights", lambda a: a[1:], r"section wrinkles.weights of the outfit has \d+ rows"),
        ("wrinkles.garments", lambda a: a + 1, "section wrinkles.garments of the outfit has the index 1"),
        ("wrinkles0.texels", lambda a: a + 2048, "section wrinkles0.texels of the outfit has the index"),
        (
            "wrinkles0.slope_starts",
            lambda a: a * 0,
            "section wrinkles0.slope_starts of the outfit does not end",
        ),
        ("wrinkles0.back_starts", lambda a: a[:-1], "section wrinkles0.back_starts of the outfit has"),
    ],
)
def test_sections_that_do_not_fit_are_refused(
    baked: BakedFile, name: str, change: Change, sentence: str
) -> None:
    sections, _ = unpack(baked.content)
    with pytest.raises(ValueError, match=sentence):
        Outfit(pack({**sections, name: change(sections[name])}))


def test_a_section_that_is_missing_is_named(baked: BakedFile) -> None:
    sections, _ = unpack(baked.content)
    del sections["wrinkles0.sides"]
    with pytest.raises(ValueError, match=r"the outfit has no section wrinkles0\.sides"):
        Outfit(pack(sections))
