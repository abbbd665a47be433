"""The identity of a body, and what follows from a body, computed once."""

import gc
import weakref
from dataclasses import replace

import pytest
import torch

from tests.small_body import small_body
from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import COLLIDER_PARTS, make_collider
from uvcloth.geometry.fingerprint import fingerprint
from uvcloth.geometry.once import once_per_record


def test_an_identity_says_in_what_two_bodies_differ() -> None:
    body = small_body()
    same = small_body().identity
    assert body.identity == same
    assert replace(body, name="other").identity == same
    larger = small_body(scale=1.001).identity
    assert larger.topology == same.topology
    assert larger.shape != same.shape
    softer = replace(body, weights=body.weights.flip(1)).identity
    assert (softer.topology, softer.shape) == (same.topology, same.shape)
    assert softer.whole != same.whole


def test_files_hold_the_hashes_of_earlier_versions() -> None:
    """Of the vertices alone, and of joint names and faces: both are in files on disk."""
    body = small_body()
    assert body.identity.shape == fingerprint(body.mesh.vertices.float())
    assert body.identity.topology == fingerprint("/".join(body.skeleton.names), body.mesh.faces)


@pytest.mark.parametrize("part", ["regions", "sides", "pose_shapes", "heads"])
def test_all_that_clothes_depend_on_is_in_the_whole(part: str) -> None:
    body = small_body()
    changed = {
        "regions": replace(body, regions=body.regions + 1),
        "sides": replace(body, sides=body.sides + 1),
        "pose_shapes": replace(body, pose_shapes=torch.ones(9, len(body.mesh.vertices), 3)),
        "heads": replace(body, skeleton=replace(body.skeleton, heads=body.skeleton.heads + 0.01)),
    }
    assert changed[part].identity.whole != body.identity.whole


def test_what_follows_from_a_body_is_computed_once_per_record_and_option() -> None:
    seen = []

    @once_per_record
    def height(body: Body, factor: float = 1.0) -> float:
        seen.append((body.name, factor))
        return factor * float(body.mesh.vertices[:, 2].max())

    first, second = small_body(), small_body(scale=2.0)
    assert [height(first), height(first, 3.0), height(second)] == pytest.approx(
        [height(first), 3.0 * height(first), 2.0 * height(first)]
    )
    assert len(seen) == 3
    assert height(first, factor=3.0) == height(first, 3.0)
    assert make_collider(first) is make_collider(first)
    assert make_collider(first) is not make_collider(second)
    assert make_collider(first, COLLIDER_PARTS).pressed == make_collider(first).pressed


def test_what_is_kept_goes_with_the_body() -> None:
    body = small_body()
    collider = weakref.ref(make_collider(body))
    del body
    gc.collect()
    assert collider() is None
