"""`make api`: HTML of the public names, from their docstrings."""

import inspect
import re
from pathlib import Path

import pdoc
import pdoc.render

import uvcloth


def test_every_public_name_has_its_words_on_the_page(tmp_path: Path) -> None:
    pdoc.render.configure(docformat="markdown", show_source=False)
    pdoc.pdoc("uvcloth", "!uvcloth[.].*", output_directory=tmp_path)
    page = (tmp_path / "uvcloth.html").read_text(encoding="utf-8")
    sections = re.split(r'<section id="(\w+)"', page)
    words = dict(zip(sections[1::2], sections[2::2], strict=True))
    assert set(words) == set(uvcloth.__all__)
    for name in set(words) - {"__version__"}:
        first = re.findall(r"\w+", inspect.getdoc(getattr(uvcloth, name)) or "")[:2]
        assert re.search(r"\W+".join(first), words[name]), name
