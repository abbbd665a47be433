"""docs/library.md and the README: every example in Python runs, in the order of the page."""

import re
from pathlib import Path

import numpy as np
import pytest

from uvcloth.bodies.body import Body
from uvcloth.garments.cage import QUALITIES
from uvcloth.garments.templates import fit_template
from uvcloth.motion.library import load_clip
from uvcloth.writers.animation import Animation
from uvcloth.writers.obj import save_obj

ROOT = Path(__file__).parents[1]
PAGES = {"docs/library.md": 8, "README.md": 1}
"""Pages, and how many examples each has at least."""


@pytest.mark.parametrize("page", PAGES)
def test_the_examples_run(
    page: str, body: Body, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Clips are cut short and cages are coarse, which changes nothing that the page says."""
    examples = re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(encoding="utf-8"), re.M | re.S)
    assert len(examples) >= PAGES[page]
    tops = fit_template("tops", body).mesh
    save_obj(fit_template("jacket", body).mesh, tmp_path / "jacket.obj")
    np.save(tmp_path / "vertices.npy", 1000 * tops.vertices.numpy())
    np.save(tmp_path / "faces.npy", tops.faces.numpy())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(QUALITIES, "default", QUALITIES["fast"])
    monkeypatch.setattr(
        "uvcloth.api.load_clip",
        lambda name, body, options: load_clip(name, body, options).window(0, 6),
    )
    names: dict[str, object] = {}
    monkeypatch.setattr("logging.basicConfig", lambda: None)
    for example in examples:
        exec(compile(example, page, "exec"), names)
    assert (tmp_path / "walk.glb").stat().st_size > 10_000
    assert isinstance(names["animation"], Animation)
    for line in re.findall(r"print\(error\)  # (.*)", "\n".join(examples)):
        assert line in capsys.readouterr().out
