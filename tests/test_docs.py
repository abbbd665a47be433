"""The pages: links lead somewhere, the manual stays short, a release is a short entry of the changelog."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MANUAL = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
PAGES = [*MANUAL, ROOT / "CHANGELOG.md", *sorted((ROOT / "docs" / "reports").glob("*.md"))]
TABLES = ("dependencies.md", "glossary.md", "runtime_file.md")
"""Pages that are a table which a test compares with the code; they do not count as text of the manual."""

OPENS_WITH_A_PICTURE = ("simulation", "physics", "physxnet", "motion_guided", "pbns", "deepsd")
FENCED = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)


def words(path: Path) -> int:
    """Number of words of a page, without the lines and rules of its tables."""
    return len(re.sub(r"\||:?-{3,}:?", " ", path.read_text(encoding="utf-8")).split())


def anchors(path: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", FENCED.sub("", path.read_text(encoding="utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", FENCED.sub("", page.read_text(encoding="utf-8"))):
        if target.startswith(("http://", "https://")):
            continue
        name, _, anchor = target.partition("#")
        linked = (page.parent / name).resolve() if name else page
        assert linked.exists(), f"{target}: no such file"
        assert not anchor or anchor in anchors(linked), f"{target}: no such heading"


def test_the_manual_is_short() -> None:
    assert words(ROOT / "README.md") < 700
    assert sum(words(page) for page in MANUAL if page.name not in TABLES) <= 15_100


@pytest.mark.parametrize("name", OPENS_WITH_A_PICTURE)
def test_pages_of_methods_begin_with_a_picture(name: str) -> None:
    text = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
    assert re.match(r"# [^\n]*\n\n(!\[|```mermaid\n)", text)


def test_a_release_is_a_short_entry_of_the_changelog() -> None:
    entries = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    assert entries
    for entry in entries:
        assert entry.count("\n") < 60, entry.splitlines()[0]
