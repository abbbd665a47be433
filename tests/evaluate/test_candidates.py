"""Candidates: models by name, by folder, in order, and with the finish of the cloth solver."""

import pytest

from evaluate.candidates import load_candidates
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.methods.ensemble import Ensemble
from uvcloth.methods.physics.finish import Finished, StaticFinish
from uvcloth.methods.physics.method import Physics


def test_a_finish_makes_another_candidate(body: Body) -> None:
    plain, dynamic, static = load_candidates(("physxnet", "physxnet@dynamic", "physxnet@static"), body)
    assert [each.name for each in (plain, dynamic, static)] == [
        "physxnet",
        "physxnet@dynamic",
        "physxnet@static",
    ]
    assert isinstance(dynamic.method, Finished)
    assert isinstance(static.method, StaticFinish)
    assert len({each.fingerprint for each in (plain, dynamic, static)}) == 3
    assert plain.training_content == dynamic.training_content != frozenset()


def test_several_in_order_have_one_finish(body: Body) -> None:
    (both,) = load_candidates(("lbs+lbs_smooth@dynamic",), body)
    assert isinstance(both.method, Finished)
    assert isinstance(both.method.guide, Ensemble)


def test_another_finish_is_refused_and_a_quality_without_cages(body: Body) -> None:
    with pytest.raises(InputError, match="--model lbs@varnish: expected one of @dynamic, @static"):
        load_candidates(("lbs@varnish",), body)
    with pytest.raises(InputError, match="--model lbs@fine: only physics and the finishes"):
        load_candidates(("lbs@fine",), body)


def test_cages_have_the_quality_of_the_name(body: Body) -> None:
    fast, fine = load_candidates(("physics@fast", "lbs@dynamic@fine"), body)
    assert isinstance(fast.method, Physics)
    assert fast.method.config.quality == "fast"
    assert isinstance(fine.method, Finished)
    assert fine.method.physics.config.quality == "fine"
    assert [fast.name, fine.name] == ["physics@fast", "lbs@dynamic@fine"]


def test_physics_is_its_own_dynamic_finish_and_rests_from_skinned_garments(body: Body) -> None:
    plain, dynamic, static = load_candidates(("physics", "physics@dynamic", "physics@static"), body)
    assert dynamic.method == plain.method
    assert isinstance(static.method, StaticFinish)
    assert static.method.guide.name == "lbs_smooth"
