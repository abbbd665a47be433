"""Meshes that nobody wears are refused with a sentence that says why; garments in metres stay where they are.

`benchmarks/refusals.py` runs all of them.
"""

from pathlib import Path

import pytest

from tests.acceptance.misfits import REFUSED, WORN
from uvcloth.bodies.body import Body
from uvcloth.garments.diagnose import diagnose
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
