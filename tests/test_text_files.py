"""Text files as the editors of other systems leave them: CRLF, a byte order mark, names in any script."""

import json
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.motion.bvh_text import bvh_text, performer, still
from uvcloth.formats.materials import TextureFiles, read_libraries
from uvcloth.formats.obj import read_obj
from uvcloth.garments.mhclo import read_binding
from uvcloth.garments.pins import pinned
from uvcloth.geometry.roles import read_role_map
from uvcloth.motion.bvh import read_bvh
from uvcloth.motion.index import read_index

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 4 3\n"

MHCLO = (
    "basemesh hm08\nobj_file a.obj\nx_scale 0 4 2\ny_scale 0 1 2\nz_scale 0 2 2\nz_depth 7\nverts 0\n"
    "0 4 6 0.5 0.5 0.0 0 0 0\n5\n"
)

INDEX = "trial,subject,split,action,window_start,window_frames\nİstanbul,ann,train,yürüme,0,9\n"


def materials(path: Path) -> Any:
    return read_libraries(TextureFiles(path.parent), [path.name])


TEXTS: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "walk.bvh": (bvh_text(performer(), still(performer())), lambda path: read_bvh(path).rotations.tolist()),
    "skirt.obj": (OBJ, lambda path: astuple(read_obj(path))),
    "cloth.mtl": ("newmtl Gün ışığı\nKd 0.5 0.25 1\n", materials),
    "shirt.mhclo": (MHCLO, lambda path: astuple(read_binding(path))),
    "index.csv": (INDEX, read_index),
    "roles.json": (json.dumps({"left_shin": "LeftLeg"}), read_role_map),
}
"""A file of each kind, and its reader."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with spaces and letters of several scripts in its name."""
    made = tmp_path / "Kleider für Łódź İ 服"
    made.mkdir()
    return made


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.parametrize("mark", ["", "\ufeff"], ids=["plain", "byte order mark"])
@pytest.mark.parametrize("ending", ["\n", "\r\n"], ids=["LF", "CRLF"])
def test_text_is_read_whichever_editor_wrote_it(folder: Path, name: str, mark: str, ending: str) -> None:
    text, read = TEXTS[name]
    path = folder / name
    path.write_bytes(text.encode())
    expected = repr(read(path))
    path.write_bytes((mark + text.replace("\n", ending)).encode())
    assert repr(read(path)) == expected


def test_vertex_numbers_may_come_with_a_byte_order_mark(folder: Path, body: Any) -> None:
    from uvcloth.garments.templates import fit_template

    path = folder / "pins.txt"
    path.write_bytes("\ufeff3\r\n7\r\n".encode())
    held = pinned([fit_template("dress", body)], body, [str(path)])
    assert np.flatnonzero(held.numpy()).tolist() == [3, 7]
