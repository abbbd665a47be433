"""Garments at rest come to lie over those before them, whatever they were made on."""

import numpy as np
import pytest
import torch

from uvcloth.bodies.body import load_body
from uvcloth.garments.garment import Garment
from uvcloth.garments.loading import load_outfit
from uvcloth.garments.order import check_order
from uvcloth.garments.templates import fit_template
from uvcloth.garments.untangling import untangle
from uvcloth.geometry.mesh import edge_lengths, unique_edges, weld
from uvcloth.physics.layers import wrong_side_percent


def crossed(outer: Garment, inner: Garment) -> float:
    return wrong_side_percent(outer.mesh.vertices[None], inner.mesh.vertices[None], inner.mesh.faces)


def test_garments_come_to_lie_over_one_another_in_the_order_that_was_said() -> None:
    body = load_body()
    shirt, dress = (fit_template(name, body) for name in ("shirt", "dress"))
    assert crossed(dress, shirt) > 70.0
    worn = untangle([shirt, dress], body)
    check_order(worn.garments)
    assert crossed(worn.garments[1], worn.garments[0]) == 0.0
    for before, after in zip((shirt, dress), worn.garments, strict=True):
        edges = unique_edges(before.mesh.faces)
        lengths = edge_lengths(before.mesh.vertices, edges)
        change = edge_lengths(after.mesh.vertices, edges) / lengths - 1.0
        assert float(change.abs().quantile(0.95)) < 0.1
        assert torch.equal(weld(before.mesh.vertices), weld(after.mesh.vertices))
    assert [line.split(":")[0].strip() for line in worn.lines] == ["shirt", "dress"]


def test_the_other_order_tucks_the_top_in() -> None:
    body = load_body()
    tops, bottoms = (fit_template(name, body) for name in ("tops", "bottoms"))
    worn = untangle([tops, bottoms], body).garments
    assert crossed(bottoms, tops) > 99.0
    assert crossed(worn[1], worn[0]) == 0.0


@pytest.mark.parametrize("names", [["bottoms", "tops"], ["bottoms", "shirt", "jacket"], ["dress"]])
def test_garments_that_do_not_cross_stay_as_they_are(names: list[str]) -> None:
    body = load_body()
    garments = [fit_template(name, body) for name in names]
    worn = untangle(garments, body)
    assert not worn.lines
    for before, after in zip(garments, worn.garments, strict=True):
        np.testing.assert_array_equal(before.mesh.vertices.numpy(), after.mesh.vertices.numpy())


def test_an_outfit_is_loaded_in_its_order_and_says_what_moved() -> None:
    body, heard = load_body(), list[str]()
    worn = load_outfit(["tops", "bottoms"], body, heard.append)
    check_order(worn)
    assert any("bottoms: untangled from the other layers" in line for line in heard)
