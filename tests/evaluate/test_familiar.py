"""What a model has met: by hash, by clip, by person, in training and in validation."""

from pathlib import Path

import pytest

from evaluate.actions import Window
from evaluate.candidates import Candidate
from evaluate.familiar import Familiar, cautions, familiarity, training_overlap
from tests.small_body import small_body
from uvcloth.methods.registry import load_method

CLIPS = {"train": {"02_01": "02", "w": ""}, "validation": {"11_01": "11", "v": ""}}


def window(clip: str, subject: str = "", garment: str = "tops") -> Window:
    return Window("walking", clip, subject, garment, Path(f"{clip}.npz"))


def candidate(seen: frozenset[str] = frozenset()) -> Candidate:
    return Candidate("net", load_method("lbs", small_body()), 0.0, "", seen, clips=CLIPS)


@pytest.mark.parametrize(
    ("met", "content", "expected"),
    [
        (window("90_01", "90"), "other", None),
        (window("90_01"), "other", None),
        (window("02_01", "02"), "hash", Familiar("train", "sequence", "02", ("02_01",))),
        (window("02_01", "02"), "other", Familiar("train", "clip", "02", ("02_01",))),
        (window("02_01"), "other", Familiar("train", "clip", "", ("02_01",))),
        (window("02_04", "02"), "other", Familiar("train", "person", "02", ("02_01",))),
        (window("renamed", "90"), "hash", Familiar("train", "sequence", "90", ())),
        (window("11_01", "11"), "hash", Familiar("validation", "sequence", "11", ("11_01",))),
        (window("11_01", "11"), "other", Familiar("validation", "clip", "11", ("11_01",))),
        (window("11_02", "11"), "other", Familiar("validation", "person", "11", ("11_01",))),
        (window("x", "ann"), "other", Familiar("train", "person", "ann", ("w",))),
        (window("x", "bob"), "other", Familiar("validation", "person", "bob", ("v",))),
    ],
)
def test_what_is_familiar(met: Window, content: str, expected: Familiar | None) -> None:
    """The index names two people whom the model leaves out."""
    people = {"w": "ann", "v": "bob", "02_01": "02"}
    assert familiarity(met, content, candidate(frozenset({"hash"})), people) == expected


def test_a_model_without_data_has_met_nothing() -> None:
    bare = Candidate("lbs", load_method("lbs", small_body()), 0.0, "", frozenset())
    assert familiarity(window("02_01", "02"), "None", bare, {"02_01": "02"}) is None


def test_cautions_are_red_unless_one_chooses_by_what_one_chose_by() -> None:
    windows = {window("02_04", "02"): "a", window("02_04", "02", "dress"): "b", window("11_01", "11"): "c"}
    said = training_overlap(candidate(), windows, {})
    assert said["trained_on"] == ["02_04_tops", "02_04_dress"]
    assert said["chosen_on"] == ["11_01_tops"]
    trained, chosen = cautions({"split": "test", "methods": {"net": said}})
    assert (trained.says, trained.windows, trained.red) == ("was trained on", 2, True)
    assert trained.familiar == ("person 02 in clip 02_01 (windows 02_04_tops, 02_04_dress)",)
    assert (chosen.says, chosen.windows, chosen.red) == ("was selected on", 1, True)
    assert chosen.familiar == ("clip 11_01 (window 11_01_tops)",)
    trained, chosen = cautions({"split": "validation", "methods": {"net": said}})
    assert (trained.red, chosen.red) == (True, False)
