"""A skirt on the body of the package, baked on coarse cages."""

import pytest

from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Outfit as WornOutfit
from uvcloth.garments.templates import fit_template
from uvcloth.methods.physics.outfit import PhysicsConfig, make_caged_outfit
from uvcloth.player.outfit import Outfit


@pytest.fixture(scope="session")
def worn(body: Body) -> WornOutfit:
    return WornOutfit(body, (fit_template("skirt", body),))


@pytest.fixture(scope="session")
def content(worn: WornOutfit) -> bytes:
    return make_caged_outfit(worn, PhysicsConfig("fast")).baked.content


@pytest.fixture(scope="session")
def outfit(content: bytes) -> Outfit:
    return Outfit(content)
