"""What nobody wears is refused with a sentence that says why; garments in metres stay where they are."""

from pathlib import Path

import pytest

from tests.acceptance.misfits import REFUSED, WORN
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.diagnose import diagnose
from uvcloth.garments.fit import place_on_body
from uvcloth.garments.judge import UnwearableError
from uvcloth.garments.placing import Placing


@pytest.mark.parametrize("name", ["dress_upside_down", "skirt_upside_down", "three_times_as_deep", "pot"])
def test_what_nobody_wears_is_refused_and_the_sentence_says_why(name: str, body: Body) -> None:
    make, sentence = REFUSED[name]
    with pytest.raises(UnwearableError, match=sentence) as caught:
        diagnose(Path("it.obj"), make(body), body, bound=True)
    assert str(caught.value).startswith("it.obj: ")
    assert "\n" not in str(caught.value)


def test_a_wide_skirt_in_metres_is_not_taken_for_a_small_one_in_feet(body: Body) -> None:
    mesh, diagnosis = diagnose(Path("it.obj"), WORN["skirt"](body), body)
    assert diagnosis.placing == Placing("m", "Z", "-Y", "body")
    assert float((mesh.vertices - WORN["skirt"](body).vertices).norm(dim=1).max()) < 1e-6


@pytest.mark.thorough
@pytest.mark.parametrize("name", REFUSED)
def test_what_nobody_wears_is_refused_wherever_it_lies(name: str, body: Body) -> None:
    make, sentence = REFUSED[name]
    with pytest.raises(InputError, match=sentence):
        place_on_body(Path("it.obj"), make(body), body)


@pytest.mark.thorough
@pytest.mark.parametrize("name", WORN)
def test_a_garment_is_worn_wherever_it_lies(name: str, body: Body) -> None:
    assert place_on_body(Path(name), WORN[name](body), body).diagnosis.way
