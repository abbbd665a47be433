"""Which vertices are pinned, by word and by file, and what is said of names that pin nothing."""

from pathlib import Path

import pytest
import torch

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.band import holding_band
from uvcloth.garments.garment import Garment
from uvcloth.garments.pins import pinned
from uvcloth.garments.templates import fit_template


@pytest.fixture(scope="module")
def dress(body: Body) -> Garment:
    return fit_template("dress", body)


def listed(path: Path, text: str) -> str:
    path.write_text(text)
    return str(path)


def test_the_band_is_what_holds_the_garment_up(dress: Garment, body: Body) -> None:
    assert torch.equal(pinned([dress], body, ["band"]), holding_band(dress, body).vertices)


def test_waist_and_neck_are_the_halves_of_the_band(dress: Garment, body: Body) -> None:
    waist, neck = (pinned([dress], body, [name]) for name in ("waist", "neck"))
    heights = dress.mesh.vertices[:, 2]
    assert heights[waist].max() + 0.1 < heights[neck].min()
    assert not (waist & neck).any()
    assert torch.equal(waist | neck, pinned([dress], body, ["band"]))
    assert torch.equal(pinned([dress], body, ["waist", "neck"]), pinned([dress], body, ["band"]))
    trousers = fit_template("bottoms", body)
    assert torch.equal(pinned([trousers], body, ["waist"]), pinned([trousers], body, ["band"]))


def test_nothing_is_pinned_by_none(dress: Garment, body: Body) -> None:
    for names in ([], ["none"], ["none", "none"]):
        held = pinned([dress], body, names)
        assert held.shape == (len(dress.mesh.vertices),)
        assert held.dtype == torch.bool
        assert not held.any()
    assert torch.equal(pinned([dress], body, ["none", "neck"]), pinned([dress], body, ["neck"]))


def test_a_file_names_vertices_and_joins_the_others(dress: Garment, body: Body, tmp_path: Path) -> None:
    last = len(dress.mesh.vertices) - 1
    path = listed(tmp_path / "pins.txt", f"0 7\n7\t12\n\n{last}\n")
    assert torch.nonzero(pinned([dress], body, [path])).squeeze(1).tolist() == [0, 7, 12, last]
    both = pinned([dress], body, ["neck", path])
    assert torch.equal(both, pinned([dress], body, ["neck"]) | pinned([dress], body, [path]))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1 two 3", "expected vertex numbers, .*'two'"),
        ("1.5", "expected vertex numbers, .*'1.5'"),
        ("3 -1", "vertex -1 is not one of the 3600 of dress"),
        ("0 3600 4", "vertex 3600 is not one of the 3600 of dress"),
        ("99999999999999999999999", "expected vertex numbers"),
        ("", "names no vertex of dress"),
    ],
)
def test_a_file_that_names_no_vertices_is_refused(
    text: str, words: str, dress: Garment, body: Body, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=rf"pins\.txt: {words}"):
        pinned([dress], body, [listed(tmp_path / "pins.txt", text)])


def test_a_name_that_is_neither_a_place_nor_a_file_is_refused(
    dress: Garment, body: Body, tmp_path: Path
) -> None:
    places = "neither a readable file of vertex numbers nor one of band, waist, neck, none"
    for name in ("wrist", str(tmp_path)):
        with pytest.raises(InputError, match=f"--pins {name}: {places}"):
            pinned([dress], body, ["band", name])
    (tmp_path / "pins.bin").write_bytes(bytes(range(128, 255)))
    with pytest.raises(InputError, match=r"pins\.bin: expected vertex numbers"):
        pinned([dress], body, [str(tmp_path / "pins.bin")])


def test_a_place_that_a_garment_lacks_is_refused(body: Body) -> None:
    with pytest.raises(InputError, match="--pins waist: names no vertex of tops"):
        pinned([fit_template("tops", body)], body, ["waist"])
    with pytest.raises(InputError, match="--pins neck: names no vertex of bottoms"):
        pinned([fit_template("bottoms", body)], body, ["band", "neck"])


def test_a_place_that_one_garment_of_an_outfit_has_is_enough(body: Body, tmp_path: Path) -> None:
    trousers, shirt = fit_template("bottoms", body), fit_template("tops", body)
    held = pinned([trousers, shirt], body, ["waist"])
    assert torch.equal(held[: len(trousers.mesh.vertices)], pinned([trousers], body, ["waist"]))
    assert not held[len(trousers.mesh.vertices) :].any()
    numbers = tmp_path / "pins.txt"
    numbers.write_text(f"3 {len(trousers.mesh.vertices) + 5}")
    listed = pinned([trousers, shirt], body, [str(numbers)])
    assert torch.nonzero(listed).flatten().tolist() == [3, len(trousers.mesh.vertices) + 5]
    with pytest.raises(InputError, match="is not one of the 3600 of tops"):
        pinned([shirt], body, [str(numbers)])
