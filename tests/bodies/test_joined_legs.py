"""The joined legs see a skirt once and continuously, on bodies of any width."""

from dataclasses import replace

import pytest
import torch

from uvcloth.bodies.body import load_body
from uvcloth.bodies.joined_legs import joined_rays, leg_faces, leg_slices
from uvcloth.garments.templates import fit_template
from uvcloth.methods.physxnet.texels import body_texels, template_texels


@pytest.fixture(scope="module", params=[1.0, 1.5], ids=["slim", "wide"])
def body(request):
    slim = load_body()
    across = torch.tensor([request.param, 1.0, 1.0])
    tights = slim.proxies["tights"]
    return replace(
        slim,
        mesh=replace(slim.mesh, vertices=slim.mesh.vertices * across),
        proxies={"tights": replace(tights, vertices=tights.vertices * across)},
    )


@pytest.fixture(scope="module")
def rays(body):
    texels = body_texels(body, 128)
    legs = leg_faces(body)[texels.sheet.face]
    sides = body.sides[texels.sheet.face[legs]]
    origins, directions = joined_rays(leg_slices(body), texels.points[legs], sides, texels.sheet.uvs[legs, 0])
    return texels, legs, sides, origins, directions


def test_rays_leave_the_axis_between_the_legs_in_every_direction(rays, body):
    texels, legs, sides, origins, directions = rays
    slices = leg_slices(body)
    torch.testing.assert_close(directions.norm(dim=1), torch.ones(len(directions)))
    assert (((origins[:, :2] - slices.middle.mean(0)) * directions[:, :2]).sum(1) > -0.02).all()
    low = texels.points[legs][:, 2] < -0.1
    heading = torch.atan2(directions[low, 1], directions[low, 0]).rad2deg()
    assert (torch.histc(heading, bins=24, min=-180.0, max=180.0) > 0).all()
    # The left leg covers the left half, up to the middle and not beyond.
    assert (directions[low, 0] * sides[low]).min() > -0.1


def test_both_legs_meet_at_the_front_and_back_centre(rays):
    texels, legs, sides, _, directions = rays
    row = (texels.points[legs][:, 2] + 0.3).abs() < 0.02
    for side in (1, -1):
        leg = row & (sides == side)
        order = texels.sheet.uvs[legs][leg, 0].argsort()
        ends = directions[leg][order][[0, -1]]
        assert ends[:, 1].prod() < 0
        assert (ends[:, 0].abs() < 0.2).all()


def test_a_skirt_is_seen_everywhere_and_without_jumps(rays, body):
    texels = rays[0]
    skirt = fit_template("dress", body).mesh
    seen = template_texels("dress", skirt, body, texels)
    below = skirt.vertices[(skirt.vertices[:, 2] < -0.05) & (skirt.vertices[:, 2] > -0.25)]
    assert torch.cdist(below, seen.points).amin(1).max() < 0.03
    places = torch.full((128 * 128, 3), torch.nan)
    places[seen.pixels] = seen.points
    islands = torch.full((128 * 128,), -1)
    islands[texels.sheet.pixels] = texels.sheet.islands
    places, islands = places.view(128, 128, 3), islands.view(128, 128)
    step = (places[:, 1:] - places[:, :-1]).norm(dim=2)
    same = (islands[:, 1:] == islands[:, :-1]) & torch.isfinite(step)
    # Above the crotch a thigh has no inside, and its rays fan out; below, neighbours stay neighbours.
    low = (places[:, 1:, 2] < -0.02) & same
    assert step[low].max() < 0.05
