"""Files of layouts: whole again after writing, refused when damaged."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.layout_file import save_layout
from uvcloth.bodies.layout import load_body_layout
from uvcloth.errors import InputError
from uvcloth.formats.layout_file import load_layout


def test_layout_survives_its_file_and_a_broken_file_is_refused(tmp_path: Path) -> None:
    layout = load_body_layout()
    path = tmp_path / "layout.npz"
    save_layout(layout, path)
    read = load_layout(path)
    assert torch.equal(read.uvs, layout.uvs)
    assert torch.equal(read.face_uvs, layout.face_uvs)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(InputError, match=r"layout\.npz"):
        load_layout(path)
    np.savez(path, format=np.array("something else"))
    with pytest.raises(InputError, match="something else"):
        load_layout(path)
    save_layout(replace(layout, uvs=layout.uvs * float("nan")), path)
    with pytest.raises(InputError, match="uvs holds a value that is not a finite number"):
        load_layout(path)
