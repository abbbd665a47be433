"""Tucks change the order in which garments are worn, or are refused in one sentence."""

from dataclasses import replace

import pytest
import torch

from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment
from uvcloth.garments.tucks import Tuck, worn_order
from uvcloth.geometry.mesh import Mesh

NOTHING = torch.zeros(0, 3)
PLAIN = Garment("", None, Mesh(NOTHING, NOTHING.long(), NOTHING, NOTHING.long()), NOTHING, NOTHING)


def order(named: str, *tucks: str) -> str:
    garments = [replace(PLAIN, name=name) for name in named.split()]
    return " ".join(garment.name for garment in worn_order(garments, [Tuck.parse(tuck) for tuck in tucks]))


def test_what_is_tucked_in_is_worn_beneath_with_all_that_it_is_worn_over() -> None:
    assert order("bottoms shirt jacket") == "bottoms shirt jacket"
    assert order("bottoms shirt jacket", "shirt:bottoms") == "shirt bottoms jacket"
    assert order("shirt bottoms", "shirt:bottoms") == "shirt bottoms"
    assert order("bottoms vest shirt jacket", "shirt:bottoms") == "vest shirt bottoms jacket"


@pytest.mark.parametrize(
    ("tucks", "words"),
    [
        (["shirt"], "--tuck shirt: expected GARMENT:INTO"),
        (["shirt:skirt"], "--tuck shirt:skirt: skirt is not worn; worn are bottoms, shirt, vest, vest"),
        (["vest:bottoms"], "vest is worn twice"),
        (
            ["shirt:bottoms", "bottoms:shirt"],
            "contradict each other, (shirt into bottoms|bottoms into shirt)",
        ),
        (["shirt:shirt"], "contradict each other, shirt into shirt"),
    ],
)
def test_tucks_that_cannot_be_are_refused(tucks: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        order("bottoms shirt vest vest", *tucks)
