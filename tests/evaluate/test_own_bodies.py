"""Outfits on bodies of their own are judged by type of garment, each on its body."""

from pathlib import Path

import pytest

from evaluate.__main__ import summary
from evaluate.candidates import load_candidates
from evaluate.compare import compare
from evaluate.records import Records
from evaluate.report import write_report
from evaluate.selection import Selection, find_cases
from evaluate.show import viewer_clips
from tests.train.deepsd.outfits import MadeUp, save_outfits
from uvcloth.errors import InputError

pytestmark = pytest.mark.usefixtures("coarse_pixels")

BAND = (0.05, 0.15)
"""Heights of a narrow band around the waist, where tops and bottoms overlap, m."""


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One outfit of two for the test, one for training that would be another."""
    folder = tmp_path_factory.mktemp("outfits")
    outfits = (
        MadeUp("both", ("bottoms", "tops"), "test", BAND),
        MadeUp("alone", ("tops",), "train", BAND),
    )
    save_outfits(folder, outfits, frames=5, warm_up=2)
    return folder


def test_figures_are_by_type_and_of_the_split(data: Path, tmp_path: Path) -> None:
    cases = find_cases(Selection(data))
    assert not cases.one_body
    candidates = load_candidates(["lbs_smooth"], cases.body)
    results, shown = compare(candidates, cases, Records(tmp_path, "a test", 0))
    smooth = results["methods"]["lbs_smooth"]
    assert list(smooth["actions"]) == ["clip0"]
    cells = smooth["actions"]["clip0"]
    assert cells.keys() == {"bottoms", "tops"}
    # The made-up cloth is the smoothly skinned one, moved outwards by up to two centimetres.
    assert 0.1 < cells["tops"]["vertex_mean_mm_raw"] < 20.0
    assert cells["tops"]["frames"] == 3
    whole = smooth["outfits"]["tops over bottoms"]["actions"]["clip0"]
    assert set(whole["wrong_side_percent"]) == {"tops"}
    assert results["windows"] == 2
    assert results["body"] == "their own (1)"
    assert "tops over bottoms" in summary(results)
    report = write_report(tmp_path, results, viewer_clips(shown), [])
    page = report.read_text()
    assert "Maps of" not in page
    # One body, which both garments and the outfit are shown on.
    assert 'id="viewer-body-0"' in page
    assert 'id="viewer-body-1"' not in page


def test_what_cannot_be_judged_is_named(data: Path, tmp_path: Path) -> None:
    cases = find_cases(Selection(data))
    candidates = load_candidates(["pbns"], cases.body)
    with pytest.raises(InputError, match=r"nothing to evaluate pbns on: .*model pbns is for tops"):
        compare(candidates, cases, Records(tmp_path, "a test", 0))
    with pytest.raises(InputError, match="no test action is called 'run', expected clip0"):
        find_cases(Selection(data, actions=("run",)))
    with pytest.raises(InputError, match="--garment is not allowed"):
        find_cases(Selection(data, files=("skirt.obj",)))
