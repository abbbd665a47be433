"""Who wears the garments of a command: characters are known by all that is in their files."""

import json
from pathlib import Path

from uvcloth.commands.run.wearer import content_of


def test_a_character_is_known_by_the_files_beside_it_too(tmp_path: Path) -> None:
    path, binary, picture = (tmp_path / name for name in ("hero.gltf", "hero.bin", "skin.png"))
    names = {"buffers": [{"uri": binary.name, "byteLength": 4}], "images": [{"uri": picture.name}]}
    path.write_text(json.dumps({"asset": {"version": "2.0"}} | names), encoding="utf-8")
    binary.write_bytes(b"1234")
    without_picture = content_of(path)
    assert content_of(path) == without_picture
    binary.write_bytes(b"1235")
    changed = content_of(path)
    picture.write_bytes(b"red")
    assert len({without_picture, changed, content_of(path)}) == 3
