"""Coarse garments are carried by proxies; others carry themselves."""

from dataclasses import replace

import torch

from tests.physics.test_face_contact import tube
from uvcloth.bodies.body import Body
from uvcloth.garments.attach import make_garment
from uvcloth.garments.garment import Outfit
from uvcloth.garments.proxy import COARSE, PROXY_EDGE, ProxiedOutfit, spacing
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.authored import AuthoredMesh, polygons_of
from uvcloth.geometry.mesh import edge_lengths, unique_edges


def test_a_proxy_stands_for_a_coarse_garment(body: Body) -> None:
    plain = tube(body, 0.002)
    mesh = AuthoredMesh.of(plain.vertices, polygons_of(plain))
    coarse = replace(make_garment("game", mesh, body, 0.06, template="bottoms"), hides=torch.tensor([5, 6]))
    fine = fit_template("tops", body)
    proxied = ProxiedOutfit.of(Outfit(body, (coarse, fine)))
    proxy, other = proxied.outfit.garments
    assert other is fine
    assert (proxy.name, proxy.template) == ("game", "bottoms")
    assert float(edge_lengths(proxy.mesh.vertices, unique_edges(proxy.mesh.faces)).max()) <= PROXY_EDGE
    assert [(name, len(shown.faces)) for name, shown in proxied.named()] == [
        ("game", len(mesh.faces)),
        ("tops", len(fine.mesh.faces)),
    ]
    assert isinstance(proxied.meshes[0], AuthoredMesh)
    assert len(proxied.lines) == 1
    assert proxied.lines[0].startswith(f"  game: coarse, {1000 * spacing(mesh):.0f} mm")
    torch.testing.assert_close(proxied.hides()[0], torch.tensor([5, 6]))
    # Moved as a whole, the garment that is shown is the proxy's first vertices.
    shift = torch.tensor([0.3, -0.2, 0.1])
    shown = proxied.shown(
        [garment.mesh.vertices + shift for garment in proxied.outfit.garments], body.mesh.vertices + shift
    )
    for places, at_rest in zip(shown, proxied.meshes, strict=True):
        torch.testing.assert_close(places, at_rest.vertices + shift, atol=1e-3, rtol=0)


def test_templates_and_fine_files_carry_themselves(body: Body) -> None:
    outfit = Outfit(body, tuple(fit_template(name, body) for name in ("bottoms", "dress")))
    assert ProxiedOutfit.of(outfit).outfit is outfit
    from_files = Outfit(body, tuple(replace(garment, source="file") for garment in outfit.garments))
    assert max(spacing(garment.mesh) for garment in from_files.garments) < COARSE
    assert ProxiedOutfit.of(from_files).outfit is from_files
