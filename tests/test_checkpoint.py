import json
import resource
from dataclasses import replace

import pytest
import torch

from tests.small_body import small_body
from uvcloth.checkpoint import (
    CONFIG,
    WEIGHTS,
    Checkpoint,
    TrainingData,
    body_record,
    load_checkpoint,
    load_tensors,
    save_checkpoint,
    save_tensors,
)
from uvcloth.errors import InputError
from uvcloth.methods.motion_guided.config import MotionGuidedConfig
from uvcloth.methods.motion_guided.method import Both, MotionGuided, motion_guided_checkpoint
from uvcloth.methods.physxnet.config import PhysXNetConfig
from uvcloth.methods.physxnet.method import PhysXNet, physxnet_checkpoint
from uvcloth.methods.registry import load_method


@pytest.fixture
def checkpoint():
    return Checkpoint(
        method="physxnet",
        config={"size": 32},
        tensors={"weight": torch.arange(6.0).view(2, 3), "count": torch.tensor(3)},
        body=body_record(small_body()),
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


@pytest.mark.parametrize(
    ("values", "kind"),
    [
        ([0, 255], torch.uint8),
        ([-1, 3], torch.int16),
        ([0, 40_000], torch.int32),
        ([0, 2**40], torch.int64),
        ([], torch.int64),
    ],
)
def test_indices_take_the_smallest_type_that_holds_them(values, kind, checkpoint, tmp_path):
    indices = torch.tensor(values, dtype=torch.int64)
    save_checkpoint(replace(checkpoint, tensors={"indices": indices}), tmp_path)
    stored = load_checkpoint(tmp_path).tensors["indices"]
    assert stored.dtype == kind
    assert torch.equal(stored.long(), indices)


def test_says_which_version_of_the_package_wrote_it(checkpoint, tmp_path, monkeypatch):
    monkeypatch.setattr("uvcloth.version.version", lambda name: {"uvcloth": "1.2.3"}[name])
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
    with pytest.raises(
        InputError, match="a model of version 1, this program reads version 3; train it again"
    ):
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


def test_a_config_that_asks_for_a_large_network_takes_no_memory(body, tmp_path):
    """The network of the config is compared with the weights before it is built."""
    tiny = MotionGuided.untrained(MotionGuidedConfig(size=8, width=8, hidden=16, seeds=61, near=16))
    checkpoint = motion_guided_checkpoint(tiny.config, Both(tiny).state_dict(), body, TrainingData(), {})
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for change, said in (
        ({"motion_stem": 1_000_000_000}, "--motion-stem 1000000000: has to be from 1 to 64"),
        ({"motion_stem": 60, "width": 1024}, "do not fit each other"),
        ({"vertices": 1_000_000, "latent": 1024}, "do not fit each other"),
        ({"norm": "x"}, "--norm 'x': has to be one of batch, group, instance, none"),
        ({"linear": "yes"}, "--linear 'yes': has to be true or false"),
        ({"size": 8.0}, r"--size 8\.0: has to be a whole number"),
    ):
        save_checkpoint(replace(checkpoint, config=checkpoint.config | change), tmp_path)
        with pytest.raises(InputError, match=said):
            load_method(tmp_path, body)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000


def test_words_of_a_config_that_name_nothing_are_refused(body, tmp_path):
    config = PhysXNetConfig(size=8, width=2, levels=2)
    checkpoint = physxnet_checkpoint(PhysXNet.untrained(config), body, TrainingData(), {})
    save_checkpoint(replace(checkpoint, config={**checkpoint.config, "frame": "x"}), tmp_path)
    with pytest.raises(InputError, match=r"config\.json: --frame 'x': has to be one of world, body"):
        load_method(tmp_path, body)
    save_checkpoint(checkpoint, tmp_path)
    text = (tmp_path / CONFIG).read_text()
    (tmp_path / CONFIG).write_text(text.replace('"frame": "body"', '"frame": ' + "[" * 10**5 + "]" * 10**5))
    with pytest.raises(InputError, match=r"config\.json: not readable as JSON.*nested too deep"):
        load_method(tmp_path, body)


def test_an_endless_name_of_a_method_is_cut(body, tmp_path):
    config = PhysXNetConfig(size=8, width=2, levels=2)
    checkpoint = physxnet_checkpoint(PhysXNet.untrained(config), body, TrainingData(), {})
    save_checkpoint(replace(checkpoint, method=10_000 * "a"), tmp_path)
    with pytest.raises(InputError, match=r"config\.json: a model of method 'a+, expected one of") as caught:
        load_method(tmp_path, body)
    assert len(str(caught.value)) < 300 + len(str(tmp_path))
