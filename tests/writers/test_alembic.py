"""Alembic files, read back by the library that others read them with."""

from pathlib import Path

import numpy as np
import pytest

from uvcloth.errors import InputError
from uvcloth.writers.alembic import write_abc
from uvcloth.writers.animation import Animation, posed_body

alembic3d = pytest.importorskip("alembic3d", reason="alembic3d is not installed")


def test_every_mesh_is_read_back_at_every_frame(animation: Animation, tmp_path: Path) -> None:
    write_abc(animation, tmp_path / "walk.abc")
    archive = alembic3d.Abc.IArchive(str(tmp_path / "walk.abc"))
    body = animation.body
    assert body is not None
    moving = [
        *zip(animation.names, animation.vertices, strict=True),
        ("body", np.concatenate(list(posed_body(animation)))),
    ]
    for name, vertices in moving:
        schema = alembic3d.AbcGeom.IPolyMesh(archive.getTop(), name).getSchema()
        assert schema.getNumSamples() == len(animation)
        for frame in (0, 17, len(animation) - 1):
            time = schema.getTimeSampling().getSampleTime(frame)
            assert time == pytest.approx(frame / animation.fps)
            sample = schema.getValue(alembic3d.Abc.ISampleSelector(time))
            x, y, z = np.asarray(sample.getPositions()).T
            # Y up to Z up: (x, -z, y).
            np.testing.assert_allclose(np.stack([x, -z, y], 1), vertices[frame], atol=1e-6)


def test_without_the_library_it_is_refused_in_a_sentence(
    animation: Animation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "alembic3d", None)
    with pytest.raises(InputError, match=r"walk\.abc: writing Alembic needs .*uvcloth\[alembic\]"):
        write_abc(animation, tmp_path / "walk.abc")
