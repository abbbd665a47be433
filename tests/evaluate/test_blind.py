"""The blind page in a browser, and the ranking of answers to it."""

import json
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from evaluate.blind import SIZE, Film, draw_pairs, video_of, write_page
from evaluate.blind_ranking import Vote, main, rank
from uvcloth.errors import InputError

METHODS = ("simulation", "physics", "jolt", "lbs")


def films(video: bytes, windows: int = 3) -> list[Film]:
    return [Film(f"w{window}", name, video) for window in range(windows) for name in METHODS]


def test_three_windows_give_each_method_six_pairs_of_films_of_one_window() -> None:
    every = films(b"")
    pairs = draw_pairs(every)
    assert len(set(pairs)) == len(pairs) == 12
    assert all(every[one].window == every[other].window for one, other in pairs)
    counts = Counter(every[k].method for pair in pairs for k in pair)
    assert counts == dict.fromkeys(METHODS, 6)
    assert len(draw_pairs(every[:2])) == 1
    with pytest.raises(InputError, match="there is only one method"):
        write_page(Path("none.html"), every[:1])


def test_the_page_works_from_a_file_with_the_keyboard(tmp_path: Path) -> None:
    pytest.importorskip("av", reason="PyAV is not installed")
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("Chromium is not installed")
    grey = [np.full((SIZE[1], SIZE[0], 3), 60 * k, np.uint8) for k in range(4)]
    page = write_page(tmp_path / "blind.html", films(video_of(grey, 30.0)))
    drive = """<script>
    const press = (key) => document.dispatchEvent(new KeyboardEvent("keydown", { key }));
    sides[0].addEventListener("loadeddata", () => { document.body.dataset.width = sides[0].videoWidth; });
    setTimeout(() => {
      ["ArrowLeft", "ArrowRight", "Backspace", "ArrowDown", "r", "x"].forEach(press);
      document.body.dataset.saved = saved();
      for (let k = 0; k < 20; k++) press("ArrowRight");
      document.body.dataset.over = byId("question").hidden;
    }, 1500);
    </script></body>"""
    page.write_text(page.read_text().replace("</body>", drive))
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=6000",
               f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", page.as_uri()]  # fmt: skip
    dom = subprocess.run(command, capture_output=True, text=True, check=True, timeout=100).stdout
    body = dom[dom.index("<body") : dom.index("<main")]
    assert f'data-width="{SIZE[0]}"' in body
    assert 'data-answered="12"' in body
    assert 'data-over="true"' in body
    text = body[body.index('data-saved="') + 12 :].split('" data-')[0].split('">')[0]
    answers = tmp_path / "answers.json"
    answers.write_text(text.replace("&quot;", '"'))
    given = json.loads(answers.read_text())["answers"]
    assert [each["answer"] for each in given] == ["left", "neither"]
    assert all({each["left"], each["right"]} < set(METHODS) for each in given)
    assert main([str(answers)]) == 0


def told(strength: dict[str, float], pairs: int, people: int) -> list[Vote]:
    """Answers of people who follow the model."""
    generator = np.random.default_rng(3)
    answers = []
    for k in range(pairs):
        left, right = generator.choice(list(strength), 2, replace=False)
        odds = 1.0 / (1.0 + np.exp(strength[right] - strength[left]))
        answers.append(Vote(left, right, float(generator.random() < odds), k % people))
    return answers


def test_the_ranking_finds_the_strengths_that_made_the_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("evaluate.blind_ranking.RESAMPLES", 60)
    true = {"simulation": 1.5, "physics": 0.5, "jolt": -0.5, "lbs": -1.5}
    ranked = rank(told(true, 1000, 10))
    assert [each.method for each in ranked] == list(true)
    for each in ranked:
        assert each.low < true[each.method] < each.high
        assert each.strength == pytest.approx(true[each.method], abs=0.3)
    few = rank(told(true, 40, 1))
    assert np.mean([each.high - each.low for each in few]) > 2 * np.mean([e.high - e.low for e in ranked])
    tied = rank([Vote("jolt", "physics", 0.5, 0)] * 9)
    assert [each.strength for each in tied] == pytest.approx([0.0, 0.0], abs=1e-6)


def test_other_files_are_refused_in_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "answers.json"
    wrong = {"left": "a", "right": "b", "answer": "both"}
    for content, says in (
        ({}, "expected answers saved by blind.html"),
        ({"format": "uvcloth-blind-1", "answers": []}, "holds no answer"),
        ({"format": "uvcloth-blind-1", "answers": [wrong]}, "expected answers of left, right or neither"),
    ):
        path.write_text(json.dumps(content))
        assert main([str(path)]) == 2
        error = capsys.readouterr().err
        assert f"{path}: " in error
        assert says in error
