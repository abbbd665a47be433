"""Bodies kept as a difference: every bit comes back, in an eighth of the size where a body is of our kind."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.small_body import small_body
from uvcloth.bodies.body import Body, body_arrays, load_body, save_body
from uvcloth.bodies.difference import load_kept_body, save_difference
from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays

FORMAT = "uvcloth-body-difference-1"


def other_person() -> Body:
    """The body that ships, taller and wider, with all that follows from its base mesh."""
    body = load_body()
    size = torch.tensor([1.1, 1.13, 1.07])
    base = body.base
    assert base is not None
    return replace(
        body,
        name="other",
        mesh=replace(body.mesh, vertices=size * body.mesh.vertices),
        skeleton=replace(body.skeleton, heads=size * body.skeleton.heads),
        base=size * base,
    )


def require_same(first: Body, second: Body) -> None:
    before, after = body_arrays(first), body_arrays(second)
    assert before.keys() == after.keys()
    for name, values in before.items():
        if "weights" in name:
            # They are scaled to a sum of one whenever a body is read.
            np.testing.assert_allclose(after[name], values, rtol=3e-7, atol=1e-9)
        else:
            np.testing.assert_array_equal(after[name], values)


@pytest.mark.parametrize("body", [other_person(), load_body(), small_body()], ids=lambda body: body.name)
def test_every_bit_comes_back(body: Body, tmp_path: Path) -> None:
    save_difference(body, tmp_path / "kept.npz")
    require_same(body, load_kept_body(tmp_path / "kept.npz"))


def test_what_a_body_shares_with_the_one_that_ships_is_left_out(tmp_path: Path) -> None:
    body = other_person()
    save_difference(body, tmp_path / "kept.npz")
    save_body(body, tmp_path / "whole.npz")
    assert (tmp_path / "kept.npz").stat().st_size < (tmp_path / "whole.npz").stat().st_size / 4
    kept = load_arrays(tmp_path / "kept.npz", FORMAT, "")
    assert {"faces", "uvs", "regions", "vertices"} & kept.keys() == set()
    require_same(body, load_kept_body(tmp_path / "whole.npz"))


def test_wrong_differences_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "kept.npz"
    save_difference(other_person(), path)
    kept = load_arrays(path, FORMAT, "")
    save_arrays(path, {**kept, "from": np.array("0" * 64)})
    with pytest.raises(
        InputError, match=r"kept.npz: is stored as a difference from another body than the one in"
    ):
        load_kept_body(path)
    save_arrays(path, {**kept, "base": kept["base"][:, :-3]})
    with pytest.raises(InputError, match=r"kept.npz: base has the shape"):
        load_kept_body(path)
    save_arrays(path, {**kept, "absent": np.array(["faces"])})
    with pytest.raises(InputError, match=r"kept.npz: lacks the array faces"):
        load_kept_body(path)
