"""Which methods have a space of garments, and the way between two of its codes."""

import torch

from evaluate.garment_space import STEPS, Generative, between
from uvcloth.bodies.body import Body
from uvcloth.garments.templates import wear
from uvcloth.methods.motion_guided import PRESETS
from uvcloth.methods.registry import CONFIGS


def test_a_linear_space_is_crossed_in_even_steps(body: Body) -> None:
    torch.manual_seed(0)
    method, dress = PRESETS["tiny"].create(), wear("dress", body)
    shapes = between(method, dress, body, seed=3)
    assert shapes.shape == (len(STEPS), len(dress.mesh.vertices), 3)
    share = torch.tensor(STEPS)[:, None, None]
    torch.testing.assert_close(shapes, share * shapes[:1] + (1 - share) * shapes[-1:], atol=1e-5, rtol=0)
    assert (shapes[0] - shapes[-1]).norm(dim=1).max() > 1e-4
    torch.testing.assert_close(between(method, dress, body, seed=3), shapes)


def test_only_methods_that_decode_are_generative() -> None:
    found = {name for name, config in CONFIGS.items() if isinstance(config.create(), Generative)}
    assert found == {"motion_guided"}
