"""Draw the picture of docs/metrics.md: what each measure sees in a made-up motion whose answer is known.

    PYTHONPATH=. python benchmarks/measures.py docs/measures.svg

Grey: the simulation. Dashed: what is judged. The figures are those of the functions that judge methods.
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from torch import Tensor

from evaluate.after_stop import stop_scores
from evaluate.body_scores import body_scores, dressed_body
from evaluate.continuity import QUARTER, turned_apart
from evaluate.force_balance import balanced_frames, force_balance, force_scores
from evaluate.hem import find_hem, hem_scores
from evaluate.look_fields import look_fields
from evaluate.metrics import (
    Reference,
    distance_scores,
    energy_scores,
    ensemble_scores,
    map_mse,
    peak_accelerations,
    shape_scores,
    spread_scores,
)
from evaluate.pixels import make_sight, pixel_scores
from evaluate.surface import make_surface
from evaluate.swing_bands import band_scores
from evaluate.wrinkles import wave_filters, wrinkle_scores
from uvcloth.bodies.body import Body
from uvcloth.files.atomic import atomic_write
from uvcloth.geometry.mesh import Mesh
from uvcloth.geometry.skeleton import Skeleton
from uvcloth.geometry.units import GRAVITY
from uvcloth.physics.exposure import covered_skin
from uvcloth.physics.fabric import JERSEY
from uvcloth.physics.measures import edge_change
from uvcloth.physics.self_intersection import crossing_edges_percent

FPS = 30.0
UP = torch.tensor([0.0, 0.0, 1.0])

WIDTH, HEIGHT, COLUMNS = 250, 150, 4
"""Size of a panel, and panels in a row."""

TRUE, JUDGED, SKIN = "t", "j", "s"
"""Styles of lines: the simulation, what is judged, skin."""

STYLE = (
    "text{font:12px sans-serif;fill:#22252a}.b{font-weight:700}polyline{fill:none}"
    ".t{stroke:#9a9fa8;stroke-width:3}.j{stroke:#1f5fae;stroke-width:1.6;stroke-dasharray:5 3}"
    ".s{stroke:#c08a70;stroke-width:6}"
)

EDGES = [-0.2, 0.2]
"""Left and right edge of an upright square, m."""

Line = tuple[str, Sequence[float], Sequence[float]]
"""Style, and horizontal and vertical coordinates."""


@dataclass(frozen=True)
class Panel:
    """A measure: lines to draw, which fill the panel, and what it says of them."""

    title: str
    lines: Sequence[Line]
    says: Sequence[str]


def sheet(across: int = 21, along: int = 21, spacing: float = 0.02) -> tuple[Tensor, Tensor]:
    """A flat sheet in the XY plane: vertices (N, 3) m and faces (M, 3)."""
    x, y = torch.meshgrid(torch.arange(across), torch.arange(along), indexing="ij")
    corner = (x[:-1, :-1] * along + y[:-1, :-1]).reshape(-1)
    a, b, c, d = corner, corner + along, corner + along + 1, corner + 1
    vertices = torch.stack([x, y, 0 * x], dim=-1).reshape(-1, 3) * spacing
    return vertices, torch.cat([torch.stack([a, b, c], 1), torch.stack([a, c, d], 1)])


def moving(offsets: Tensor) -> Reference:
    """A sheet that moves by offsets (F, N or 1, 3) m from its skinned shape."""
    rest, faces = sheet()
    skinned = rest.expand(len(offsets), -1, -1)
    return Reference(skinned + offsets, (), skinned, rest, faces, FPS, None, None)


def waving(hertz: float, amplitude: float = 0.02, delay: float = 0.0, frames: int = 120) -> Tensor:
    """Offsets (F, 1, 3) m, up and down. delay: s."""
    seconds = torch.arange(frames) / FPS - delay
    return amplitude * torch.sin(2 * math.pi * hertz * seconds)[:, None, None] * UP


def fields(case: Reference, judged: Tensor) -> dict[str, Any]:
    """Fields of bands of a motion (F, N, 3) m."""
    scores = {
        **band_scores(judged, case), "wrinkle_mm2": torch.zeros(1, 4), "peak_acceleration": torch.zeros(0),
    }  # fmt: skip
    return look_fields([scores], [scores], ["clip"], "")


def over_time(style: str, offsets: Tensor, frames: int = 45) -> Line:
    """The height of a sheet over time."""
    return style, list(range(frames)), offsets[:frames, 0, 2].tolist()


def distances() -> Panel:
    """A shift of 3 and 4 mm."""
    case = moving(waving(2.0))
    far = float(
        distance_scores(case.vertices + torch.tensor([0.003, 0.0, 0.004]), case.vertices)["vertex_mean_mm"][0]
    )
    x = np.linspace(0, 400, 50)
    curve = 20 * np.sin(x / 50)
    lines = [(TRUE, x.tolist(), curve.tolist()), (JUDGED, (x + 3).tolist(), (curve + 4).tolist())]
    return Panel("Mean vertex distance", lines, [f"3 mm aside, 4 mm up: {far:.2f} mm"])


def halved() -> Panel:
    """Half the amplitude."""
    case = moving(waving(2.0))
    got = fields(case, case.skinned + waving(2.0, 0.01))
    says = f"half the swing: {got['swing_ratio_1_3_hz']:.2f} ({got['swing_correlation_1_3_hz']:.2f})"
    lines = [over_time(TRUE, waving(2.0)), over_time(JUDGED, waving(2.0, 0.01))]
    return Panel("Swing ratio (correlation)", lines, [says])


def delayed() -> Panel:
    """The same swing 50 ms later."""
    case = moving(waving(2.0))
    got = fields(case, case.skinned + waving(2.0, delay=0.05))
    says = f"50 ms late: {got['swing_ratio_1_3_hz']:.2f} ({got['swing_correlation_1_3_hz']:.2f})"
    lines = [over_time(TRUE, waving(2.0)), over_time(JUDGED, waving(2.0, delay=0.05))]
    return Panel("Correlation of swing", lines, [says])


def banded() -> Panel:
    """A sway and a flutter, of which the flutter is missing."""
    truth = waving(2.0) + waving(5.5, 0.01)
    case = moving(truth)
    got = fields(case, case.skinned + waving(2.0))
    says = [f"1 to 3 Hz: {got['swing_ratio_1_3_hz']:.2f}, 3 to 8 Hz: {got['swing_ratio_3_8_hz']:.2f}"]
    return Panel("Swing by frequency", [over_time(TRUE, truth), over_time(JUDGED, waving(2.0))], says)


def wrinkled() -> Panel:
    """Waves of 70 mm over a flat sheet."""
    rest, faces = sheet(81, 11, 0.01)
    height = 0.01 * torch.cos(2 * math.pi * rest[:, 0] / 0.07)
    case = Reference((rest + height[:, None] * UP)[None], (), rest[None], rest, faces, FPS, None, None)
    squares = wrinkle_scores(wave_filters(make_surface(rest, faces)), case.vertices, case)["wrinkle_mm2"][0]
    share = float(squares[2] / squares.sum())
    fine = np.linspace(0, 0.8, 300)
    waves = [(JUDGED, fine.tolist(), (0.01 * np.cos(2 * math.pi * fine / 0.07)).tolist())]
    flat = [(TRUE, [0.0, 0.8], [0.0, 0.0]), (TRUE, [0.0], [0.05])]
    return Panel(
        "Wrinkles by wavelength", flat + waves, [f"waves of 70 mm: {100 * share:.0f} % in 50 to 100 mm"]
    )


def hemmed() -> Panel:
    """Saw teeth of 4 mm, and a hem that moves by 3 mm in a frame."""
    case = moving(torch.zeros(2, 1, 3))
    hem = find_hem(case.rest, case.faces)
    index = torch.arange(len(case.rest))
    teeth = 0.004 * ((index // 21 + index % 21) % 2)[:, None] * UP
    rough = float(hem_scores(hem, case.skinned + teeth, case)["hem_roughness_mm"][0])
    swung = moving(torch.tensor([0.0, 0.003])[:, None, None] * UP)
    square = float(hem_scores(hem, swung.vertices, swung)["hem_square"][0])
    x = list(range(21))
    lines = [(TRUE, x, [0.0] * 21), (JUDGED, x, [4.0 * (k % 2) for k in x]), (TRUE, [0], [12.0])]
    return Panel(
        "Hems", lines, [f"teeth of 4 mm: roughness {rough:.1f} mm", f"3 mm a frame: energy {square:.1f} mm²"]
    )


def popping() -> Panel:
    """One frame 5 mm up."""
    spike = torch.zeros(45, 441, 3)
    spike[22, :, 2] = 0.005
    case = moving(torch.zeros(45, 1, 3))
    peak = float(peak_accelerations(case.skinned + spike, case).max())
    lines = [over_time(TRUE, torch.zeros(45, 1, 3)), over_time(JUDGED, spike)]
    return Panel("Popping", lines, [f"5 mm up for a frame: {peak:.1f} m/s²"])


def unbalanced() -> Panel:
    """A sheet that falls, and one that floats."""
    seconds = torch.arange(9) / FPS
    fall = -0.5 * GRAVITY * seconds.square()[:, None, None] * UP
    forces = []
    for offsets in (fall, torch.zeros(9, 1, 3)):
        case, frames = moving(offsets), balanced_frames(9)
        balance = force_balance(make_surface(case.rest, case.faces), replace(JERSEY, drag=0.0))
        far = torch.ones(len(frames), len(case.rest))
        forces.append(float(force_scores(balance, case.vertices, frames, far, FPS)["force_median"].max()))
    lines = [over_time(TRUE, fall, 9), over_time(JUDGED, torch.zeros(9, 1, 3), 9)]
    return Panel("Unbalanced force", lines, [f"falls: {forces[0]:.1f}, floats: {forces[1]:.1f} m/s²"])


def stopped() -> Panel:
    """A body that walks for a second and stands; cloth that swings out, and cloth that freezes."""
    frames, walk = 90, 30
    seconds = (torch.arange(frames) - walk).clamp(min=0) / FPS
    circle = torch.stack([torch.sin(20 * seconds), 0 * seconds, torch.cos(20 * seconds)], 1)[:, None]
    swing = 0.05 * torch.exp(-seconds)[:, None, None] * circle
    walked = torch.arange(frames).clamp(max=walk)[:, None, None] * torch.tensor([0.03, 0.0, 0.0])
    case = moving(swing)
    case = replace(case, skinned=case.skinned + walked, vertices=case.vertices + walked)
    true, frozen = (stop_scores(each, case) for each in (case.vertices, case.skinned))
    energies = [each["stop_energy"].tolist() for each in (true, frozen)]
    x = list(range(len(energies[0])))
    says = [f"settles in {float(true['settle_s']):.1f} s, frozen: {float(frozen['settle_s']):.1f} s"]
    return Panel("Energy after a stop", [(TRUE, x, energies[0]), (JUDGED, x, energies[1])], says)


def chance() -> Panel:
    """Two simulations 4 mm apart, and a method 8 mm from both of them."""
    case = moving(torch.zeros(30, 1, 3))
    case = replace(case, members=(case.vertices + 0.004 * UP,))
    side = torch.tensor([math.sqrt(0.008**2 - 0.002**2), 0.0, 0.002])
    judged = case.vertices + side
    far = float(ensemble_scores(judged, case)["ensemble_mm"][0])
    apart = float(spread_scores(case)["spread_vertex_mean_mm"][0])
    energy = float(energy_scores([judged, judged], case)["energy_score_mm"][0])
    lines = [
        (TRUE, [0.0, 0.0], [0.0, 4.0]),
        (JUDGED, [0.0, 7.75, 0.0], [0.0, 2.0, 4.0]),
        (TRUE, [0.0], [8.0]),
    ]
    return Panel(
        "Spread ratio, energy score",
        lines,
        [f"8 mm off, 4 mm apart: {far / apart:.2f}", f"two rollouts there: energy score {energy:.1f} mm"],
    )


def stretched() -> Panel:
    """A sheet that is 2 % longer."""
    rest, faces = sheet()
    longer = rest * torch.tensor([1.02, 1.02, 1.0])
    change = 1000 * float(edge_change(longer[None], rest, faces)[0])
    lines = []
    for style, factor, height in ((TRUE, 1.0, 0.0), (JUDGED, 1.02, 1.0)):
        for k in range(6):
            lines.append((style, [factor * k, factor * k], [height, height + 0.7]))
        lines.append((style, [0.0, 5 * factor], [height, height]))
    return Panel("Edge change", lines, [f"2 % longer, edges of 20 and 28 mm: {change:.2f} mm"])


def crossed() -> Panel:
    """Two sheets, of which one stands through the other along a line."""
    rest, faces = sheet()
    upright = torch.stack([rest[:, 0] + 0.001, torch.full_like(rest[:, 0], 0.203), rest[:, 1] - 0.203], 1)
    both = torch.cat([rest, upright])
    percent = float(crossing_edges_percent(both[None], torch.cat([faces, faces + len(rest)]))[0])
    lines = [(TRUE, [0.0, 0.4], [0.0, 0.0]), (JUDGED, [0.203, 0.203], [-0.2, 0.2])]
    return Panel("Edges through cloth", lines, [f"one sheet through another: {percent:.1f} %"])


def upright(depth: float) -> Mesh:
    """A square of 40 cm that faces the front (-Y), at a depth, m."""
    points, faces = sheet(81, 81, 0.005)
    shape = torch.stack([points[:, 0] - 0.2, torch.full_like(points[:, 0], depth), points[:, 1] + 0.8], 1)
    return Mesh(shape, faces, shape[:, :2], faces)


def pushed(mesh: Mesh, back: float) -> Tensor:
    """Vertices of it whose middle is pushed back, m."""
    middle = ((mesh.vertices - torch.tensor([0.0, 0.0, 1.0]))[:, [0, 2]].abs() <= 0.0501).all(1)
    return mesh.vertices + middle[:, None] * torch.tensor([0.0, back, 0.0])


def slab() -> Body:
    """A body whose front is 2 cm behind the plane y = 0, and much wider than a square."""
    box = trimesh.creation.box((1.0, 0.2, 1.8)).subdivide().subdivide().subdivide()
    shape = torch.tensor(box.vertices).float() + torch.tensor([0.0, 0.12, 0.9])
    faces = torch.tensor(box.faces).long()
    none = torch.zeros(len(faces), dtype=torch.long)
    skeleton = Skeleton(("hips",), (-1,), torch.zeros(1, 3))
    mesh = Mesh(shape, faces, shape[:, :2], faces)
    return Body("slab", mesh, skeleton, torch.ones(len(shape), 1), none, none, {})


def shares(meshes: Sequence[Mesh], frames: Sequence[Tensor]) -> dict[str, list[float]]:
    """Percent of pixels at fault of garments on the slab, all as one, in some frames (N, 3) m."""
    body = slab()
    sight = make_sight(body, meshes, covered_skin(body, meshes))
    scores = pixel_scores(sight, torch.stack(list(frames)), body.mesh.vertices.expand(len(frames), -1, -1))
    return {key: values.tolist() for key, values in scores.items()}


def pixels() -> list[Panel]:
    """Cloth that was pushed through skin, and through an inner garment, over 10 of 40 cm."""
    panels = []
    for title, key, depths, back in (
        ("Skin in pictures", "skin_pixels_percent", (0.0,), 0.03),
        ("Cloth through cloth", "cloth_pixels_percent", (0.0, -0.01), 0.018),
    ):
        meshes = [upright(depth) for depth in depths]
        moved = pushed(meshes[-1], back)
        (percent,) = shares(meshes, [torch.cat([*(each.vertices for each in meshes[:-1]), moved])])[key]
        row = slice(40, None, 81)
        lines = [(JUDGED, moved[row, 0].tolist(), (-moved[row, 1]).tolist()), (SKIN, EDGES, [-0.02, -0.02])]
        lines += [(TRUE, EDGES, [-depth, -depth]) for depth in depths[:-1]]
        panels.append(Panel(title, lines, [f"1/16 pushed through: {percent:.1f} % of pixels"]))
    return panels


def inside() -> Panel:
    """A square in front of skin, of which a part lies behind the skin."""
    mesh, body = upright(0.0), slab()
    moved = pushed(mesh, 0.03)
    posed = body.mesh.vertices[None]
    percent = float(body_scores(dressed_body(body, [mesh]), moved[None], posed)["inside_percent"][0])
    row = slice(40, None, 81)
    lines = [(JUDGED, moved[row, 0].tolist(), (-moved[row, 1]).tolist()), (SKIN, EDGES, [-0.02, -0.02])]
    return Panel("Vertices inside the body", lines, [f"1/16 of them behind skin: {percent:.1f} %"])


def mapped() -> Panel:
    """The shift of 3 and 4 mm in a map whose texels see one corner each."""
    case = moving(torch.zeros(1, 1, 3))
    corners = torch.arange(len(case.rest))[:, None].expand(-1, 3)
    weights = torch.tensor([[1.0, 0.0, 0.0]]).expand(len(corners), 3)
    case = replace(case, texel_corners=corners, texel_barycentrics=weights)
    mse = float(map_mse(case.vertices + torch.tensor([0.003, 0.0, 0.004]), case)["map_mse_mm2"][0])
    steps = [float(k // 2) for k in range(1, 17)]
    true = [10.0 * math.sin(k // 2) for k in range(16)]
    lines = [(TRUE, steps, true), (JUDGED, steps, [each + 4.0 for each in true])]
    return Panel("Map MSE", lines, [f"texels 3 mm aside, 4 mm up: {mse:.1f} mm²"])


def bent() -> Panel:
    """A sheet that turns by 0.2 rad from one row of quads to the next."""
    rest, faces = sheet()
    angle = rest[:, 0] * 10.0
    curl = torch.stack([0.1 * torch.sin(angle), rest[:, 1], 0.1 - 0.1 * torch.cos(angle)], 1)
    case = Reference(curl[None], (), rest[None], rest, faces, FPS, None, None)
    radians = float(shape_scores(case.vertices, case)["bend_rad"][0])
    lines = [(TRUE, [0.0, 0.4], [0.0, 0.0]), (JUDGED, curl[::21, 0].tolist(), curl[::21, 2].tolist())]
    return Panel("Bends", lines, [f"a third of the edges by 0.2 rad: {radians:.3f} rad"])


def jittered() -> Panel:
    """The same swing, twice as fast."""
    case = moving(waving(2.0))
    true, fast = (
        float(shape_scores(each, case)["jitter"].mean())
        for each in (case.vertices, case.skinned + waving(4.0))
    )
    lines = [over_time(TRUE, waving(2.0)), over_time(JUDGED, waving(4.0))]
    return Panel("Jitter ratio", lines, [f"twice as fast: {fast / true:.1f} times the acceleration"])


def turned() -> Panel:
    """A method that pulls cloth 3 mm to the east, however the scene is turned."""
    east = torch.tensor([0.003, 0.0, 0.0])
    frames = sheet()[0][None]
    apart = float(turned_apart(frames @ QUARTER.T + east, frames + east).mean())
    x, y = [0.0, 4.0, 4.0, 0.0, 0.0], [0.0, 0.0, 4.0, 4.0, 0.0]
    lines = [
        (TRUE, [-4.0 - each for each in y], x),
        (TRUE, [-4.0 - each for each in y], [each + 1.0 for each in x]),
        (JUDGED, [-3.0 - each for each in y], x),
        (TRUE, x, y),
        (JUDGED, [each + 1.0 for each in x], y),
    ]
    return Panel("Turned scene", lines, [f"always 3 mm to the east: {apart:.2f} mm"])


def represented() -> Panel:
    """A wave that is read back from every twentieth of its points."""
    places = np.arange(0, 401)
    wave = 10.0 * np.sin(places / 20.0)
    kept = places[::20]
    read = np.interp(places, kept, wave[kept])
    both = torch.tensor(np.stack([wave, read]), dtype=torch.float32)[:, None, :, None] / 1000.0 * UP
    far = float(distance_scores(both[1], both[0])["vertex_mean_mm"][0])
    lines = [(TRUE, places.tolist(), wave.tolist()), (JUDGED, kept.tolist(), wave[kept].tolist())]
    return Panel("Representation floor", lines, [f"waves of 10 mm, 6 points each: {far:.2f} mm"])


def panels() -> list[Panel]:
    """All of them."""
    made = (
        distances, mapped, chance, represented, halved, delayed, banded, stopped, jittered, popping, turned,
        unbalanced, wrinkled, hemmed, stretched, bent, crossed, inside,
    )  # fmt: skip
    return [*(make() for make in made), *pixels()]


def drawn(panel: Panel, left: float, top: float) -> str:
    """A panel as SVG, its lines stretched over it."""
    x, y = (np.concatenate([np.asarray(line[k], float) for line in panel.lines]) for k in (1, 2))
    low, high = np.array([x.min(), y.min()]), np.array([x.max(), y.max()])
    wide = np.where(high > low, high - low, 1.0)
    tall = HEIGHT - 62 - 14 * (len(panel.says) - 1)

    def place(line: Line) -> str:
        across, up = ((np.asarray(line[k + 1], float) - low[k]) / wide[k] for k in (0, 1))
        return " ".join(
            f"{left + 12 + (WIDTH - 36) * a:.0f},{top + 28 + tall * (1 - u):.0f}"
            for a, u in zip(across, up, strict=True)
        )

    lines = [f'<polyline class="{line[0]}" points="{place(line)}"/>' for line in panel.lines]
    words = [
        f'<text x="{left + 12}" y="{top + HEIGHT - 16 - 14 * (len(panel.says) - 1 - k)}">{text}</text>'
        for k, text in enumerate(panel.says)
    ]
    return "\n".join([f'<text class="b" x="{left + 12}" y="{top + 16}">{panel.title}</text>', *lines, *words])


@torch.no_grad()
def picture() -> str:
    """All panels as one SVG."""
    every = panels()
    rows = -(-len(every) // COLUMNS)
    size = f'viewBox="0 0 {COLUMNS * WIDTH} {rows * HEIGHT}"'
    parts = [drawn(each, k % COLUMNS * WIDTH, k // COLUMNS * HEIGHT) for k, each in enumerate(every)]
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size}><style>{STYLE}</style>'
    return "\n".join([head, '<rect width="100%" height="100%" fill="#fff"/>', *parts, "</svg>\n"])


if __name__ == "__main__":
    with atomic_write(Path(sys.argv[1])) as partial:
        partial.write_text(picture(), encoding="utf-8")
