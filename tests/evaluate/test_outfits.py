"""Garments that were simulated together are judged as one outfit: each, all together, and side by side."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

import evaluate.selection as selecting
from evaluate import records
from evaluate.__main__ import summary
from evaluate.candidates import Candidate, load_candidates
from evaluate.compare import compare
from evaluate.records import Records
from evaluate.report import write_report
from evaluate.selection import Selection, cases_on
from evaluate.show import Shown, pictures, viewer_clips
from tests.evaluate.test_compare import (
    COUNTED,
    FILE_MM,
    LBS,
    SETTLING,
    Sinking,
    capsule_body,
    simulated,
    tube_garment,
)
from uvcloth.bodies.frames import BodyFrames
from uvcloth.dataset.clip_file import load_simulated, save_simulated
from uvcloth.errors import InputError
from uvcloth.garments.garment import Garment, Outfit
from uvcloth.methods.ensemble import Ensemble
from uvcloth.methods.method import Method

pytestmark = pytest.mark.usefixtures("coarse_pixels")

OUTFIT = "tops over bottoms"
RADIUS = {"bottoms": 0.18, "tops": 0.21, "dress": 0.18}


def fitted(name: str, *_: object) -> Garment:
    return tube_garment(name, RADIUS[name])


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Tops that were simulated over bottoms, 10 and 5 mm above their rest, and a dress alone."""
    monkeypatch.setattr(selecting, "fit_template", fitted)
    monkeypatch.setattr(selecting, "garment_map", lambda *_: None)
    folder = tmp_path / "data"
    for name, off in (("bottoms", 0.005), ("tops", 0.010), ("dress", 0.0)):
        sequence = simulated(fitted(name), "02_04", torch.tensor([0.0, 0.0, off]))
        layers = {} if name == "dress" else {"layers": ["bottoms", "tops"]}
        save_simulated(sequence.labelled(**layers), folder / f"02_04_{name}.npz")
    return folder


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of records for tests that judge the same: what one has judged the next takes over."""
    return tmp_path_factory.mktemp("records")


def judged(
    data: Path, out: Path, methods: Sequence[Method] = (), models: tuple[str, ...] = ("lbs",)
) -> tuple[dict[str, Any], list[Shown]]:
    body = capsule_body()
    given = [Candidate(method.name, method, 0.0, "", frozenset()) for method in methods]
    return compare(
        [*load_candidates(models, body), *given],
        cases_on(body, Selection(data, map_size=16)),
        Records(out, "a test", 16),
    )


@dataclass(frozen=True)
class Shrunk(Method):
    """The baseline, but its tops are narrower than the bottoms."""

    name: str = "shrunk"

    def prepare(self, outfit: Outfit, device: torch.device) -> Any:
        return LBS.prepare(outfit, device)

    def step(self, prepared: Any, state: Any, frames: BodyFrames) -> tuple[Any, tuple[Tensor, ...]]:
        state, garments = LBS.step(prepared, state, frames)
        middle = frames.transforms[:, -1, 0, :, 3]
        narrow = torch.tensor([0.17 / 0.21, 0.17 / 0.21, 1.0])
        return state, (*garments[:-1], (garments[-1] - middle[:, None]) * narrow + middle[:, None])


def test_each_garment_and_all_together_are_scored(data: Path, shared: Path) -> None:
    results, _ = judged(data, shared)
    lbs = results["methods"]["lbs"]
    actions = lbs["actions"]["02_04"]
    assert actions["bottoms"]["vertex_mean_mm_raw"] == pytest.approx(5.0, abs=FILE_MM)
    assert actions["tops"]["vertex_mean_mm_raw"] == pytest.approx(10.0, abs=FILE_MM)
    assert actions.keys() == {"bottoms", "tops", "dress"}
    assert lbs["outfits"].keys() == results["outfits"].keys() == {OUTFIT}
    assert results["outfits"][OUTFIT]["garments"] == ["bottoms", "tops"]
    cell = lbs["outfits"][OUTFIT]["actions"]["02_04"]
    assert cell["frames"] == COUNTED
    assert cell["vertex_mean_mm_raw"] == pytest.approx(7.5, abs=FILE_MM)
    assert cell["vertex_mse_mm2_raw"] == pytest.approx((25.0 + 100.0) / 2, abs=20 * FILE_MM)
    assert cell["map_mse_mm2"] is None
    assert cell["ms_per_frame"] > 0.0
    assert "ms_per_frame" not in actions["tops"]
    assert actions["dress"]["ms_per_frame"] > 0.0
    assert lbs["outfits"][OUTFIT]["stability"]["one_step_mm_raw"] == pytest.approx(7.5, abs=FILE_MM)
    assert len(lbs["outfits"][OUTFIT]["over_time_mm"]) == COUNTED
    assert (results["windows"], results["frames"]) == (3, 3 * COUNTED)
    json.dumps(results, allow_nan=False)


def test_what_is_under_what_it_should_cover_is_counted(data: Path, shared: Path) -> None:
    results, _ = judged(data, shared, [Shrunk()])
    ours = results["methods"]["shrunk"]["outfits"][OUTFIT]["actions"]["02_04"]
    true = results["simulation"]["outfits"][OUTFIT]["actions"]["02_04"]
    assert ours["wrong_side_percent_raw"] == {"tops": {"bottoms": 100.0}}
    assert ours["wrong_side_percent"]["tops"]["bottoms"] < 1.0
    assert true["wrong_side_percent"] == true["wrong_side_percent_raw"] == {"tops": {"bottoms": 0.0}}


def test_several_models_in_order_dress_an_outfit(data: Path, shared: Path) -> None:
    results, shown = judged(data, shared, models=("lbs", "lbs_smooth+lbs"))
    one, two = results["methods"]["lbs"], results["methods"]["lbs_smooth+lbs"]
    assert two["actions"]["02_04"].keys() == {"bottoms", "tops"}
    figures = [m["outfits"][OUTFIT]["actions"]["02_04"]["vertex_mean_mm"] for m in (one, two)]
    assert figures[0] == pytest.approx(figures[1], abs=1e-4)
    assert [list(each.meshes) for each in shown] == [
        ["simulation", "lbs", "lbs_smooth+lbs"],
        ["simulation", "lbs"],
    ]
    assert f"{OUTFIT} lbs_smooth+lbs" in summary(results)
    clips = viewer_clips(shown)
    assert [clip.garment for clip in clips] == [OUTFIT, "dress"]
    (drawn, *_) = pictures(shown, list(results["methods"]), lambda jobs: (job.run() for job in jobs))
    assert OUTFIT in drawn.caption
    page = write_report(data.parent, results, clips, [drawn]).read_text()
    assert 'id="outfits"' in page


def test_methods_that_use_feedback_see_the_truth_of_all_garments(data: Path, shared: Path) -> None:
    """Each sinks by a millimetre a frame from wherever it was left; the tops are cleared off the bottoms."""
    results, _ = judged(data, shared, [replace(Ensemble.of((Sinking(), Sinking())), name="both")])
    both = results["methods"]["both"]
    whole = both["outfits"][OUTFIT]
    for steps, off in ((both["stability"]["tops"], 10.0), (whole["stability"], 7.5)):
        assert off <= steps["one_step_mm_raw"] < off + 2.5
    for lasting, off in (
        (both["over_time_mm_raw"]["bottoms"], 5.0),
        (both["over_time_mm_raw"]["tops"], 10.0),
    ):
        alone = [(off**2 + (SETTLING + 1.0 + frame) ** 2) ** 0.5 for frame in range(COUNTED)]
        assert lasting == pytest.approx(alone, abs=0.1)


def test_garments_of_an_outfit_belong_together(data: Path, shared: Path) -> None:
    tops = data / "02_04_tops.npz"
    sequence = load_simulated(tops)
    save_simulated(replace(sequence, warm_up=SETTLING - 1), tops)
    with pytest.raises(InputError, match=r"02_04_tops\.npz: has another body motion than 02_04_bottoms\.npz"):
        judged(data, shared)
    tops.unlink()
    with pytest.raises(InputError, match=r"02_04_bottoms\.npz: was simulated with the garment tops"):
        judged(data, shared)


def test_a_finished_outfit_is_taken_over(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, _ = judged(data, tmp_path / "out")
    monkeypatch.setattr(records, "judge", lambda *_: pytest.fail("judged again"))
    assert judged(data, tmp_path / "out")[0] == first
