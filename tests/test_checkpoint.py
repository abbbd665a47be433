import json

import pytest
import torch

from rasterize.errors import InputError
from tests.small_body import small_body
from uvcloth.checkpoint import (
    CONFIG,
    WEIGHTS,
    Checkpoint,
    TrainingData,
    body_identity,
    load_checkpoint,
    load_tensors,
    save_checkpoint,
    save_tensors,
)


@pytest.fixture
def checkpoint():
    return Checkpoint(
        method="physxnet",
        config={"size": 32},
        tensors={"weight": torch.arange(6.0).view(2, 3), "count": torch.tensor(3)},
        body=body_identity(small_body()),
        garments=("tops",),
        data=TrainingData({"walk_tops.npz": "abc"}, {"train": {"walk": "ann"}, "validation": {"run": ""}}),
        notes={"step": 7},
    )


def test_comes_back_equal(checkpoint, tmp_path):
    save_checkpoint(checkpoint, tmp_path / "run")
    loaded = load_checkpoint(tmp_path / "run", small_body())
    assert loaded.config == checkpoint.config
    assert loaded.garments == checkpoint.garments
    assert loaded.data == checkpoint.data
    for name, tensor in checkpoint.tensors.items():
        assert torch.equal(loaded.tensors[name], tensor)
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == [CONFIG, WEIGHTS]


def test_says_which_version_of_the_package_wrote_it(checkpoint, tmp_path, monkeypatch):
    monkeypatch.setattr("uvcloth.checkpoint.version", lambda name: {"uvcloth": "1.2.3"}[name])
    save_checkpoint(checkpoint, tmp_path)
    assert json.loads((tmp_path / CONFIG).read_text())["uvcloth"] == "1.2.3"


def test_a_file_in_the_place_of_the_folder_is_named(checkpoint, tmp_path):
    (tmp_path / "run").write_text("a file")
    with pytest.raises(InputError, match="run: cannot be made a folder"):
        save_checkpoint(checkpoint, tmp_path / "run")


def test_refuses_another_topology(checkpoint, tmp_path):
    save_checkpoint(checkpoint, tmp_path)
    with pytest.raises(InputError, match="another"):
        load_checkpoint(tmp_path, small_body(flipped=True))


def test_accepts_another_shape(checkpoint, tmp_path):
    save_checkpoint(checkpoint, tmp_path)
    assert load_checkpoint(tmp_path, small_body(scale=1.3)).method == "physxnet"


def test_refuses_another_version(checkpoint, tmp_path):
    save_checkpoint(checkpoint, tmp_path)
    meta = json.loads((tmp_path / CONFIG).read_text())
    (tmp_path / CONFIG).write_text(json.dumps({**meta, "version": 1}))
    with pytest.raises(InputError, match="a model of version 1, this program reads version 3; train it anew"):
        load_checkpoint(tmp_path)


def test_names_what_is_damaged(checkpoint, tmp_path):
    save_checkpoint(checkpoint, tmp_path)
    content = (tmp_path / WEIGHTS).read_bytes()
    (tmp_path / WEIGHTS).write_bytes(content[:-5])
    with pytest.raises(InputError, match=WEIGHTS):
        load_checkpoint(tmp_path)
    (tmp_path / CONFIG).write_text("{")
    with pytest.raises(InputError, match=CONFIG):
        load_checkpoint(tmp_path)
    with pytest.raises(InputError, match="not a trained model"):
        load_checkpoint(tmp_path / "nowhere")


def test_a_weight_that_is_not_finite_is_refused(tmp_path):
    save_tensors({"weight": torch.tensor([1.0, torch.nan])}, {}, tmp_path / "x.safetensors")
    with pytest.raises(InputError, match="weight"):
        load_tensors(tmp_path / "x.safetensors")
