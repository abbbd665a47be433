"""Outfits without some of their garments."""

import numpy as np
import pytest

from tests.player.small_outfit import small_motion, small_outfit
from uvcloth.player.outfit import Cloth, Outfit
from uvcloth.player.sections import pack, unpack
from uvcloth.player.worn import without_others


@pytest.fixture(scope="module")
def both() -> bytes:
    """A skirt over a slip, packed as a file has it."""
    return pack(*unpack(small_outfit()), compressed=True)


@pytest.mark.parametrize("worn", [(0,), (1,)])
def test_what_is_left_is_as_it_was(both: bytes, worn: tuple[int, ...]) -> None:
    whole, less = Outfit(both), Outfit(without_others(both, worn))
    (place,) = worn
    assert less.garments == (whole.garments[place],)
    assert less.cages < whole.cages
    # No vertex of a cage is lost: those of the two outfits of one garment are those of both.
    (other,) = {0, 1} - set(worn)
    assert less.cages + Outfit(without_others(both, (other,))).cages == whole.cages
    old, _ = unpack(both)
    new, _ = unpack(without_others(both, worn))
    first, end = old["garments.starts"][place : place + 2]
    np.testing.assert_array_equal(new["points.rest"], old["points.rest"][first:end])
    # Each point follows the same places of the cages by the same shares.
    rest = {id(each): each["cages.rest"][each["follow.cage"]] for each in (old, new)}
    a, b = old["follow.starts"][[first, end]]
    np.testing.assert_array_equal(rest[id(new)], rest[id(old)][a:b])
    corners = new["cages.rest"][new["sheet.faces"]]
    assert all((old["cages.rest"][old["sheet.faces"]] == each).all((1, 2)).any() for each in corners)


def test_the_garment_that_is_left_moves_alone(both: bytes) -> None:
    motion = small_motion()
    frames = []
    for content in (both, without_others(both, (0,))):
        cloth = Cloth(Outfit(content))
        cloth.start(motion[0])
        for joints in motion:
            cloth.step(joints, 1.0 / 30.0)
        frames.append(cloth.vertices(0))
    # It hangs as beneath the other, which hardly presses it.
    apart = np.linalg.norm(frames[1] - frames[0], axis=1)
    assert 0.0 < apart.max() < 0.02


@pytest.mark.parametrize("worn", [(0,), (1,)])
def test_what_is_left_keeps_its_wrinkles(both: bytes, worn: tuple[int, ...]) -> None:
    old, _ = unpack(both)
    content = without_others(both, worn)
    new, steps = unpack(content)
    np.testing.assert_array_equal(new["wrinkles.garments"], [0])
    np.testing.assert_array_equal(new["wrinkles0.texels"], old[f"wrinkles{worn[0]}.texels"])
    np.testing.assert_array_equal(new["wrinkles.weights"], old["wrinkles.weights"])
    assert not any(name.startswith("wrinkles1.") for name in (*new, *steps))


def test_without_garments_that_have_wrinkles_there_is_no_network(both: bytes) -> None:
    sections, steps = unpack(both)
    sections["wrinkles.garments"] = sections["wrinkles.garments"][:1]
    one = {name: array for name, array in sections.items() if not name.startswith("wrinkles1.")}
    content = without_others(pack(one, {name: step for name, step in steps.items() if name in one}), (1,))
    assert not any(name.startswith("wrinkles") for name in unpack(content)[0])
    assert Outfit(content).garments == (7 * 12,)


def test_all_garments_are_the_same_bytes(both: bytes) -> None:
    assert without_others(both, (0, 1)) == both
