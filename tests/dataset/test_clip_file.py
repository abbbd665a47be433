"""Files of simulated clips: what survives them, layers, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.dataset.altered import altered
from tests.simulation.skinned import skinned_sequence
from uvcloth.bodies.body import Body
from uvcloth.dataset.clip import SimulatedClip, SimulatedGarment, content_hash
from uvcloth.dataset.clip_file import SEQUENCE_FORMAT, load_simulated, read_metadata, save_simulated
from uvcloth.errors import InputError
from uvcloth.files.archive import load_arrays, save_arrays
from uvcloth.garments.templates import fit_template


@pytest.fixture(scope="module")
def skinned(body: Body) -> SimulatedClip:
    """A shirt that is simply skinned."""
    return skinned_sequence(fit_template("tops", body), body)


def test_a_sequence_survives_its_file(skinned: SimulatedClip, tmp_path: Path) -> None:
    save_simulated(skinned, tmp_path / "s.npz")
    again = load_simulated(tmp_path / "s.npz")
    assert (again.vertices - skinned.vertices).norm(dim=-1).max() < 5e-5
    assert torch.equal(again.transforms, skinned.transforms)
    (before,), (garment,) = skinned.garments, again.garments
    for exact in ("rest", "faces"):
        assert torch.equal(getattr(garment, exact), getattr(before, exact))
    content = content_hash(garment, again.transforms)
    assert garment.metadata["hash"] == again.files["s.npz"] == content
    assert read_metadata(tmp_path / "s.npz")["hash"] == content
    assert garment.metadata["scored_frames"] == 3
    assert (again.warm_up, garment.name, again.name) == (1, "tops", "walk")
    assert (garment.template, again.layers) == ("tops", ("tops",))
    (skirt,) = altered(skinned, {"garment": "skirt", "template": "dress"}).garments
    assert (skirt.name, skirt.template) == ("skirt", "dress")
    assert altered(skinned, {"template": None}).garments[0].template is None
    assert [path.name for path in tmp_path.iterdir()] == ["s.npz"]


def test_an_older_sequence_is_refused_with_the_way_to_a_new_one(tmp_path: Path) -> None:
    save_arrays(tmp_path / "s.npz", {"format": np.array("uvcloth-sequence-1")})
    for read in (load_simulated, read_metadata):
        with pytest.raises(InputError, match=r"simulate older ones again .* found format uvcloth-sequence-1"):
            read(tmp_path / "s.npz")


@pytest.mark.parametrize(
    ("part", "array"), [("vertices", "changes"), ("rest", "rest"), ("transforms", "transforms")]
)
def test_a_sequence_with_a_number_that_is_not_finite_is_refused(
    skinned: SimulatedClip, tmp_path: Path, part: str, array: str
) -> None:
    good = {"transforms": skinned.transforms, **vars(skinned.garments[0])}
    save_simulated(altered(skinned, **{part: good[part] * float("nan")}), tmp_path / "s.npz")
    with pytest.raises(InputError, match=rf"s\.npz: {array} holds a value"):
        load_simulated(tmp_path / "s.npz")


@pytest.mark.parametrize(
    ("metadata", "words"),
    [("{", "not readable as JSON"), ("[]", "not a JSON object"), ('{"clip": "walk"}', "lacks 'garment'")],
)
def test_damaged_metadata_is_refused(
    skinned: SimulatedClip, tmp_path: Path, metadata: str, words: str
) -> None:
    save_simulated(skinned, tmp_path / "s.npz")
    arrays = load_arrays(tmp_path / "s.npz", SEQUENCE_FORMAT, "a sequence")
    save_arrays(tmp_path / "s.npz", {**arrays, "metadata": np.array(metadata)})
    with pytest.raises(InputError, match=rf"s\.npz: the metadata: {words}"):
        load_simulated(tmp_path / "s.npz")


def test_layers_have_a_file_each_and_come_back_as_one_clip(tmp_path: Path) -> None:
    transforms = torch.eye(3, 4).repeat(3, 2, 1, 1)
    triangle, faces = torch.eye(3), torch.tensor([[0, 1, 2]])
    moving = triangle.repeat(3, 1, 1)
    garments = tuple(
        SimulatedGarment(name, size * moving, faces, size * triangle, {"template": template})
        for name, size, template in (("o1_vest", 1.0, "tops"), ("o1_coat", 2.0, None))
    )
    said = {"clip": "walk", "layers": ["o1_vest", "o1_coat"], "types": {"o1_coat": "coat"}, "body": "ann"}
    clip = SimulatedClip(garments, transforms, 30.0, 1, said)
    paths = [tmp_path / "vest.npz", tmp_path / "coat.npz"]
    save_simulated(clip, *paths)
    again = load_simulated(*paths)
    assert dict(again.metadata) == said
    assert (again.name, again.layers) == ("walk", ("o1_vest", "o1_coat"))
    assert [again.kind(name) for name in again.layers] == ["tops", "coat"]
    assert again.outfit == "o1_vest_o1_coat_ann"
    assert [*again.from_folder("data").files] == ["data/vest.npz", "data/coat.npz"]
    assert again.vertices.shape == (3, 6, 3)
    coat = again.alone("o1_coat")
    torch.testing.assert_close(coat.vertices, 2.0 * moving, atol=1e-4, rtol=0)
    save_simulated(coat.labelled(action="walking"), paths[1])
    assert load_simulated(paths[1]).action == "walking"
    save_simulated(altered(coat, warm_up=2), paths[1])
    with pytest.raises(InputError, match=r"coat\.npz: has another body motion than vest\.npz of the same"):
        load_simulated(*paths)
