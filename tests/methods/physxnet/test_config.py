"""Which decoder of PhysXNet serves a garment: its template's, one LIKE it, or none."""

from dataclasses import replace

import pytest

from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.methods.physxnet.config import PRESETS
from uvcloth.methods.physxnet.method import PhysXNet, template_mesh

TINY = PRESETS["tiny"]


def test_decoders_serve_their_template_and_those_like_it() -> None:
    assert TINY.decoder("dress") == "dress"
    assert (TINY.decoder("shirt"), TINY.decoder("jacket"), TINY.decoder("skirt")) == ("tops", "tops", "dress")
    assert replace(TINY, templates=("tops", "shirt")).decoder("shirt") == "shirt"
    assert replace(TINY, templates=("dress",)).decoder("shirt") is None
    assert TINY.decoder(None) is None


def test_a_network_that_would_see_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="--no-motion --no-pose: leave the network without input"):
        replace(TINY, motion=False, pose=False)


def test_a_garment_without_template_is_refused(body: Body) -> None:
    bare = replace(fit_template("tops", body), name="vest", template=None, source="file")
    reason = PhysXNet.untrained(TINY).unsupported_reason(Outfit(body, (bare,)))
    assert reason.startswith("garment vest: model physxnet has no decoder for a garment without template")


def test_the_template_s_mesh_is_that_of_the_garment_that_is_the_template(body: Body) -> None:
    tops = fit_template("tops", body)
    moved = replace(tops.mesh, vertices=tops.mesh.vertices + 0.01)
    fitted = Outfit(body, (replace(tops, name="vest", mesh=moved),))
    assert template_mesh("tops", fitted) is moved
    file = Outfit(body, (replace(tops, mesh=moved, source="file"),))
    assert template_mesh("tops", file) is not moved
