"""Pixels at fault of squares that were pushed behind what they hide, over a known part of their area."""

import re
from pathlib import Path

import pytest
import torch

from benchmarks.measures import picture, pushed, shares, upright
from uvcloth.geometry.mesh import Mesh

FAULT = pytest.approx(100.0 / 16.0, abs=1.5)
"""Percent of the pixels where 10 of 40 cm were pushed; a pixel of 8 mm more or less is 1 %."""


def test_skin_shows_where_cloth_was_pushed_into_the_body_and_not_where_it_was_taken_away() -> None:
    cloth = upright(0.0)
    aside = cloth.vertices + torch.tensor([0.3, 0.0, 0.0])
    scores = shares([cloth], [cloth.vertices, pushed(cloth, 0.03), pushed(cloth, 0.2), aside])
    assert scores["skin_pixels_percent"] == [0.0, FAULT, pytest.approx(0.0, abs=0.2), 0.0]
    assert scores["cloth_pixels_percent"] == [0.0] * 4


def test_an_inner_garment_and_an_inner_side_show_where_the_outer_one_was_pushed() -> None:
    outer, inner = upright(-0.01), upright(0.0)
    layers = shares([inner, outer], [torch.cat([inner.vertices, pushed(outer, 0.018)])])
    assert layers == {"skin_pixels_percent": [0.0], "cloth_pixels_percent": [FAULT]}
    # One garment: a front, and behind it the inner side of its back.
    vertices = torch.cat([outer.vertices, inner.vertices])
    faces = torch.cat([outer.faces, inner.faces.flip(1) + len(outer.vertices)])
    both = Mesh(vertices, faces, vertices[:, :2], faces)
    frames = [vertices, torch.cat([pushed(outer, 0.018), inner.vertices])]
    assert shares([both], frames)["cloth_pixels_percent"] == [0.0, FAULT]


def test_the_picture_in_the_manual_has_the_figures_of_the_measures() -> None:
    drawn = (Path(__file__).parents[2] / "docs" / "measures.svg").read_text(encoding="utf-8")
    texts = re.findall(r"<text[^>]*>([^<]*)", drawn)
    assert texts == re.findall(r"<text[^>]*>([^<]*)", picture())
    assert {"half the swing: 0.50 (1.00)", "50 ms late: 1.00 (0.81)", "3 mm aside, 4 mm up: 5.00 mm"} <= {
        *texts
    }
