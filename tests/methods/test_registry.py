"""The registry: light to import, and true about the methods behind its lines."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from uvcloth.checkpoint import load_checkpoint
from uvcloth.methods.capabilities import Riggable
from uvcloth.methods.method import MethodEntry
from uvcloth.methods.registry import METHODS, SHIPPED, Registered, list_methods, list_rigs


@pytest.mark.parametrize("name", METHODS)
def test_a_line_leads_to_an_entry(name: str) -> None:
    entry = METHODS[name].entry
    assert isinstance(entry, MethodEntry)
    method = entry.create(entry.config)
    assert method.name == name
    assert bool(method.capability(Riggable)) == METHODS[name].rig
    assert f"{name} ({METHODS[name].about})" in list_methods()


def test_what_ships_is_registered_and_can_be_loaded() -> None:
    for folder in SHIPPED.iterdir():
        assert METHODS[folder.name].entry.load
        assert load_checkpoint(folder).method == folder.name


@pytest.mark.parametrize("folder", sorted(SHIPPED.iterdir()), ids=lambda folder: folder.name)
def test_what_ships_has_a_card(folder: Path) -> None:
    card = (folder / "README.md").read_text(encoding="utf-8")
    head = card.split("---\n")[1].splitlines()
    for key in ("license: apache-2.0", "library_name: uvcloth", "tags: [", "datasets: [", "metrics:"):
        assert any(line.startswith(key) for line in head), key
    assert any(re.fullmatch(r'  - \{name: ".+", value: [0-9.]+\}', line) for line in head)
    for heading in ("## Training", "## Error", "## Limits"):
        assert f"\n{heading}\n" in card
    assert f"uvcloth train {folder.name} " in card


def test_rigs_in_help_are_those_that_ship(monkeypatch: pytest.MonkeyPatch) -> None:
    assert list_rigs() == (
        "recurrent (tops, shirt, bottoms, dress) or pbns (bottoms under tops) or deepsd (any garments)"
    )
    monkeypatch.setitem(METHODS, "mine", Registered("mine", METHODS["pbns"].entry, rig=True))
    assert "mine" in list_methods()
    assert "mine" not in list_rigs()


def test_the_tables_import_no_method() -> None:
    code = (
        "import sys; from uvcloth.methods.registry import list_methods; from train.__main__ import run; "
        "list_methods(); run(['--help']); print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    loaded = set(done.stdout.split())
    assert not loaded & {"torch", "numpy", "uvcloth.methods.method", "uvcloth.methods.lbs"}
