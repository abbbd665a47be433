"""Sewing: pieces have the length, openings and layers that their design says, off the skin of the body."""

from dataclasses import replace
from functools import cache

import pytest
import torch

from rasterize.charts import boundary_loops
from uvcloth.bodies.body import Body, load_body
from uvcloth.errors import InputError
from uvcloth.garments.shells import joint
from uvcloth.geometry.mesh import Mesh, unique_edges, weld
from uvcloth.physics.layers import wrong_side_percent
from uvcloth.physics.surface import BodySurface
from uvcloth.wardrobe.check import LEAST_OFF, refuse_faulty
from uvcloth.wardrobe.designs import Design, Legs, Skirt, Upper
from uvcloth.wardrobe.sew import Meshing, sew

pytest.importorskip("pyacvd", reason="sewing needs the remesher of uvcloth[body]")

SHIRT = Upper(
    sleeve=0.55,
    hem=0.02,
    neck_depth=0.0,
    neck_width=0.07,
    neck_power=2.0,
    ease=0.02,
    sleeve_ease=0.015,
    flare=0.0,
    front_gap=0.0,
)
TROUSERS = Legs(drop=0.03, length=1.9, ease=0.015, flare=0.01)
SKIRT = Skirt(drop=0.03, length=1.0, ease=0.02, flare=0.2, slit=0.0, slit_height=0.5, slit_side=0.0)
COARSE = Meshing(vertices=1000, even=True, seams=False)


@cache
def body() -> Body:
    return load_body()


@cache
def worn(design: Design, meshing: Meshing = COARSE) -> Mesh:
    mesh = sew([design], meshing, body())[0]
    refuse_faulty([design.kind], [mesh], body())
    return mesh


def openings(mesh: Mesh) -> int:
    return len(boundary_loops(weld(mesh.vertices)[mesh.faces].numpy()))


def test_a_tshirt_has_four_openings_and_ends_above_the_elbows() -> None:
    mesh = worn(Design("tshirt", upper=SHIRT))
    assert len(mesh.vertices) == pytest.approx(1000, rel=0.05)
    assert openings(mesh) == 4
    elbow = abs(joint(body(), "LeftForeArm")[0])
    assert 0.7 * elbow < float(mesh.vertices[:, 0].max()) < elbow
    off = BodySurface(body().mesh.vertices, body().mesh.faces).closest(mesh.vertices).signed_distance
    assert float(off.min()) >= LEAST_OFF


def test_an_open_front_makes_of_neck_and_hem_one_opening_and_a_gap_down_the_middle() -> None:
    jacket = worn(Design("jacket", upper=replace(SHIRT, sleeve=1.8, front_gap=0.05)))
    assert openings(jacket) == 3
    front = jacket.vertices[(jacket.vertices[:, 1] < -0.06) & (jacket.vertices[:, 2] < 0.6)]
    assert float(front[:, 0].abs().min()) > 0.012
    wrist = abs(joint(body(), "LeftHand")[0])
    assert float(jacket.vertices[:, 0].max()) == pytest.approx(0.95 * wrist, abs=0.06)


def test_trousers_end_where_their_length_says_and_flare_widens_them() -> None:
    straight = worn(Design("trousers", legs=TROUSERS))
    wide = worn(Design("trousers", legs=replace(TROUSERS, flare=0.05)))
    assert openings(straight) == 3
    ankle = joint(body(), "LeftFoot")[2]
    assert 0.05 < float(straight.vertices[:, 2].min()) - ankle < 0.12

    def width(mesh: Mesh) -> float:
        left = mesh.vertices[(mesh.vertices[:, 2] < ankle + 0.15) & (mesh.vertices[:, 0] > 0)]
        return float(left[:, 1].max() - left[:, 1].min())

    assert width(wide) > width(straight) + 0.04


def test_a_skirt_flares_and_a_slit_opens_its_hem() -> None:
    mesh = worn(Design("skirt", skirt=replace(SKIRT, slit=0.12)))
    low, high = mesh.vertices[:, 2].min(), mesh.vertices[:, 2].max()
    hem = mesh.vertices[mesh.vertices[:, 2] < low + 0.05]
    band = mesh.vertices[mesh.vertices[:, 2] > high - 0.05]
    assert float(hem[:, 1].max() - hem[:, 1].min()) > 1.3 * float(band[:, 1].max() - band[:, 1].min())
    # The slit is at the left, which is +X: there the hem has no cloth.
    side = hem[hem[:, 0] > 0.5 * hem[:, 0].max()]
    assert float(side[:, 1].abs().min()) > 0.004
    assert openings(mesh) == 2


def test_a_shirt_lies_over_trousers_everywhere() -> None:
    designs = [Design("trousers", legs=TROUSERS), Design("tshirt", upper=SHIRT)]
    inner, outer = sew(designs, COARSE, body())
    refuse_faulty(["trousers", "tshirt"], [inner, outer], body())
    assert wrong_side_percent(outer.vertices[None], inner.vertices[None], inner.faces) == 0.0
    with pytest.raises(InputError, match="cannot be worn over the garment tshirt"):
        refuse_faulty(["tshirt", "trousers"], [outer, inner], body())


def test_seams_double_vertices_and_change_nothing_else() -> None:
    design = Design("tshirt", upper=SHIRT)
    welded, sewn = worn(design), worn(design, replace(COARSE, seams=True))
    assert len(sewn.vertices) > len(welded.vertices) + 20
    assert len(weld(sewn.vertices).unique()) == len(welded.vertices)
    assert torch.equal(sewn.vertices[sewn.faces], welded.vertices[welded.faces])


def test_edges_are_shorter_at_cuffs() -> None:
    mesh = worn(Design("longsleeve", upper=replace(SHIRT, sleeve=1.9)))
    rims = [mesh.vertices[rim] for rim in boundary_loops(mesh.faces.numpy())]
    cuffs = [rim for rim in rims if abs(float(rim[:, 0].mean())) > 0.3]
    assert len(cuffs) == 2
    edges = mesh.vertices[unique_edges(mesh.faces)]
    whole = float((edges[:, 0] - edges[:, 1]).norm(dim=1).mean())
    for rim in cuffs:
        assert float((rim - rim.roll(1, 0)).norm(dim=1).mean()) < 0.85 * whole


def test_uneven_meshes_differ_more_in_their_edges() -> None:
    design = Design("tshirt", upper=SHIRT)

    def spread(mesh: Mesh) -> float:
        corners = mesh.vertices[mesh.faces]
        lengths = (corners - corners.roll(1, 1)).norm(dim=2)
        return float(lengths.std() / lengths.mean())

    assert spread(worn(design, replace(COARSE, even=False))) > 1.6 * spread(worn(design))


def test_faults_are_named() -> None:
    mesh = worn(Design("tshirt", upper=SHIRT))
    inside = mesh.vertices.clone()
    inside[0] *= 0.9
    broken, turned = inside.clone(), mesh.faces.clone()
    broken[1] = torch.nan
    turned[0] = turned[0].flip(0)
    first = (torch.arange(len(mesh.vertices)) == mesh.faces[0, 0])[:, None]
    for vertices, faces, sentence in (
        (inside, mesh.faces, "tshirt: comes within -?[0-9.]+ mm of the skin, expected 3 mm"),
        (broken, mesh.faces, "tshirt: a vertex is not a finite number"),
        (mesh.vertices, mesh.faces.flip(1), "tshirt: its faces point inward"),
        (
            torch.where(first, mesh.vertices[mesh.faces[0, 1]], mesh.vertices),
            mesh.faces,
            "a face has no area",
        ),
        (mesh.vertices, turned, "two faces at an edge have opposite orientations"),
        (
            mesh.vertices,
            mesh.faces[mesh.vertices[mesh.faces].mean(1)[:, 2].sub(0.5).abs() > 0.03],
            "consists of",
        ),
    ):
        with pytest.raises(InputError, match=sentence):
            refuse_faulty(["tshirt"], [replace(mesh, vertices=vertices, faces=faces)], body())
