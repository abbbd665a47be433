"""The body's sheet: no folds, well used, even, and mirror-symmetric."""

from pathlib import Path

import numpy as np
import pytest
import torch

from rasterize.bake import bake, scatter_map, valid_mask
from rasterize.charts import face_components
from rasterize.layout import UNWRAP_WORKER, Layout, layout_of_uvs, unwrap
from rasterize.texels import rasterize_layout
from uvcloth.bodies.body import REGIONS, Body
from uvcloth.bodies.layout import body_layout, load_body_layout
from uvcloth.errors import InputError


@pytest.fixture(scope="module")
def layout() -> Layout:
    return load_body_layout()


def signed_areas(uvs: torch.Tensor, face_uvs: torch.Tensor) -> torch.Tensor:
    corners = uvs.double()[face_uvs]
    along, across = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return (along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]) / 2


def test_no_face_is_turned_over(layout: Layout) -> None:
    assert signed_areas(layout.uvs, layout.face_uvs).min() > -1e-9


def test_sheet_is_used_and_head_hands_and_feet_are_not_on_it(layout: Layout, body: Body) -> None:
    texels = rasterize_layout(layout, 256)
    assert len(texels) > 0.9 * 256**2
    regions = {
        REGIONS[region] for region in body.regions[texels.face].bincount().nonzero().flatten().tolist()
    }
    assert {"torso", "upper_arm", "forearm", "thigh", "calf"} <= regions
    pruned = [REGIONS.index(name) for name in ("head", "hand", "foot")]
    assert torch.isin(body.regions[texels.face], torch.tensor(pruned)).float().mean() < 0.005


def test_charts_get_texels_as_their_surface(layout: Layout, body: Body) -> None:
    a, b, c = body.mesh.vertices.double()[body.mesh.faces[layout.faces]].unbind(1)
    surface = torch.linalg.cross(b - a, c - a).norm(dim=1) / 2
    density = signed_areas(layout.uvs, layout.face_uvs).abs() / surface
    means, spreads = [], []
    for island in range(6):
        chosen = layout.islands == island
        share = surface[chosen] / surface[chosen].sum()
        mean = (share * density[chosen]).sum()
        means.append(float(mean))
        spreads.append(float((share * (density[chosen] / mean - 1) ** 2).sum().sqrt()))
    assert int(layout.islands.max()) == 5
    assert max(means) / min(means) < 1.1
    assert max(spreads) < 0.6


def test_flipping_a_map_mirrors_the_body(layout: Layout, body: Body) -> None:
    texels = rasterize_layout(layout, 128)
    positions = scatter_map(bake(body.mesh.vertices, body.mesh.faces, texels), texels)
    mirrored = positions.flip(-1) * torch.tensor([-1.0, 1.0, 1.0])[:, None, None]
    assert torch.equal(valid_mask(texels), valid_mask(texels).flip(-1))
    assert (positions - mirrored).abs().max() < 1e-4


def test_left_arm_lies_on_the_right_of_the_sheet(layout: Layout, body: Body) -> None:
    arm = (body.regions[layout.faces] == REGIONS.index("forearm")) & (body.sides[layout.faces] > 0)
    assert layout.uvs[layout.face_uvs[arm]][..., 0].min() > 0.5


def test_shipped_layout_is_the_one_that_the_code_makes(layout: Layout, body: Body) -> None:
    made = body_layout(body)
    assert torch.equal(made.faces, layout.faces)
    assert (made.uvs - layout.uvs).abs().max() < 1e-3


def sphere() -> tuple[torch.Tensor, torch.Tensor]:
    import trimesh

    made = trimesh.creation.icosphere(4)
    return torch.from_numpy(made.vertices).float(), torch.from_numpy(made.faces.copy())


def test_islands_of_a_large_mesh_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = sphere()

    def largest() -> int:
        _, face_uvs = unwrap(vertices, faces, "ball")
        return int(np.bincount(face_components(face_uvs.numpy(), np.zeros(0, dtype=np.int64))).max())

    assert largest() > 600
    monkeypatch.setattr("rasterize.layout.CHART_VERTICES", 150)
    assert largest() < 2 * 1.5 * 150


def test_a_mesh_on_which_xatlas_ends_the_process_is_unwrapped_from_an_uneven_copy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    worker = tmp_path / "worker.py"
    worker.write_text(
        f"import os, pathlib, runpy\ntried = pathlib.Path({str(tmp_path / 'tried')!r})\n"
        "if not tried.exists():\n    tried.touch()\n    os.abort()\n"
        f"runpy.run_path({str(UNWRAP_WORKER)!r})\n"
    )
    monkeypatch.setattr("rasterize.layout.UNWRAP_WORKER", worker)
    vertices, faces = sphere()
    _, face_uvs = unwrap(vertices, faces, "ball")
    assert (tmp_path / "tried").exists()
    assert face_uvs.shape == faces.shape


@pytest.mark.parametrize(
    ("ending", "reason"),
    [
        ("import os; os.abort()", "xatlas ended with code -6"),
        ("raise MemoryError('no more room')", "MemoryError: no more room"),
    ],
)
def test_a_mesh_that_xatlas_cannot_unwrap_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str, reason: str
) -> None:
    worker = tmp_path / "worker.py"
    worker.write_text(ending)
    monkeypatch.setattr("rasterize.layout.UNWRAP_WORKER", worker)
    with pytest.raises(InputError, match=f"^ball: the mesh cannot be unwrapped: {reason}$"):
        unwrap(*sphere(), "ball")


def test_unwrap_keeps_the_vertex_order_and_overlaps_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    import trimesh

    # With it, NumPy writes arrays into pipes that it refuses otherwise.
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    cylinder = trimesh.creation.cylinder(radius=0.3, height=1.0, sections=24)
    vertices = torch.from_numpy(cylinder.vertices.copy()).float()
    faces = torch.from_numpy(cylinder.faces.copy())
    uvs, face_uvs = unwrap(vertices, faces, "ball")
    assert face_uvs.shape == faces.shape
    assert 0.0 <= uvs.min() <= uvs.max() <= 1.0
    # What the faces cover together is what the sheet shows: no two lie on the same place.
    texels = rasterize_layout(layout_of_uvs(uvs, face_uvs), 512)
    assert len(texels) / 512**2 == pytest.approx(float(signed_areas(uvs, face_uvs).abs().sum()), rel=0.02)
