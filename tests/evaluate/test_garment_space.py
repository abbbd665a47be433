"""Which methods have a space of garments, and the way between two of its codes."""

import torch

from evaluate.candidates import SIMULATION
from evaluate.garment_space import BLEND_SHARES, between, farthest, random_pair
from evaluate.show import Shown
from tests.train.simulated import swaying
from uvcloth.bodies.body import Body
from uvcloth.bodies.frames import body_frames, with_lead
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.geometry.skinning import skin
from uvcloth.methods.capabilities import GarmentSpace, garment_space
from uvcloth.methods.motion_guided.config import PRESETS
from uvcloth.methods.motion_guided.method import MotionGuided
from uvcloth.methods.registry import METHODS


def space_of(dress: Garment, body: Body) -> GarmentSpace:
    torch.manual_seed(0)
    space = MotionGuided.untrained(PRESETS["tiny"]).garment_space(dress, body)
    assert space is not None
    return space


def test_a_linear_space_is_crossed_in_even_steps(body: Body) -> None:
    dress = fit_template("dress", body)
    space = space_of(dress, body)
    first, second = random_pair(space)
    assert not torch.equal(first, second)
    shapes = between(space, first, second)
    assert shapes.shape == (len(BLEND_SHARES), len(dress.mesh.vertices), 3)
    share = torch.tensor(BLEND_SHARES)[:, None, None]
    torch.testing.assert_close(shapes, share * shapes[:1] + (1 - share) * shapes[-1:], atol=1e-5, rtol=0)
    assert (shapes[0] - shapes[-1]).norm(dim=1).max() > 1e-4


def test_the_codes_farthest_apart_are_those_of_the_garments_that_differ_most(body: Body) -> None:
    dress = fit_template("dress", body)
    space = space_of(dress, body)
    transforms = swaying(4, seed=0).transforms()
    skinned = skin(dress.mesh.vertices, dress.smooth_weights, transforms)
    wide = skinned.clone()
    wide[1] += 0.05
    wide[3] -= 0.05
    window = Shown("sway", "sway", Outfit(body, (dress,)), 30.0, 1, transforms, {SIMULATION: wide})
    first, second = farthest(space, [window])
    codes = space.encode(wide, transforms)
    assert {int((codes - code).norm(dim=1).argmin()) for code in (first, second)} == {1, 3}


def test_only_methods_that_decode_have_a_space(body: Body) -> None:
    dress = fit_template("dress", body)
    methods = {name: line.entry.create(line.entry.config) for name, line in METHODS.items()}
    assert [name for name, method in methods.items() if garment_space(method, dress, body)] == [
        "motion_guided"
    ]


def test_a_round_trip_goes_through_the_space(body: Body) -> None:
    """On the body at rest, posing changes nothing: what is left is the way to the code and back."""
    dress = fit_template("dress", body)
    torch.manual_seed(0)
    method = MotionGuided.untrained(PRESETS["tiny"])
    prepared = method.prepare(Outfit(body, (dress,)), torch.device("cpu"))
    still = torch.eye(3, 4).expand(2, len(body.skeleton.names), 3, 4)
    wide = torch.stack([dress.mesh.vertices, 1.05 * dress.mesh.vertices])
    (read,) = method.round_trip(prepared, body_frames(body, with_lead(still), 30.0), (wide,))
    space = method.garment_space(dress, body)
    assert space is not None
    torch.testing.assert_close(read, space.decode(space.encode(wide, still)), atol=1e-5, rtol=0)
