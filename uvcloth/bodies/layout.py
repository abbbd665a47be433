"""UV layout of a body: torso front and back in the middle, arms above legs on either side."""

from importlib.resources import files as resources
from pathlib import Path

import numpy as np
import torch
from scipy.spatial import cKDTree

from rasterize.charts import (
    boundary_loops,
    cheapest_path,
    edge_keys,
    edges_of,
    face_components,
    largest_piece,
    path_edges,
)
from rasterize.layout import Chart, Layout, lay_out
from uvcloth.bodies.body import REGIONS, Body, load_body
from uvcloth.errors import InputError
from uvcloth.formats.layout_file import load_layout
from uvcloth.geometry.mesh import face_pairs, vertex_normals

PRUNED, TORSO, LEFT_ARM, RIGHT_ARM, LEFT_LEG, RIGHT_LEG, FRONT, BACK = range(-1, 7)
LIMB_LABELS = {"left arm": LEFT_ARM, "right arm": RIGHT_ARM, "left leg": LEFT_LEG, "right leg": RIGHT_LEG}

CHART_MARGIN = 1.0 / 256.0
"""Half the gutter: two texels between charts at 256 x 256."""

SEAM_LENGTH_COST = 0.05
"""Cost of a metre of seam that runs exactly on the side where it should, against 1 at right angles."""


def body_layout(body: Body) -> Layout:
    """Make the UV layout of a body (PhysXNet section 4.2): six charts, head, hands and feet pruned.

    Torso front and back are cut at the sides, shoulders and crotch; arms along the underside and legs along
    the inner line, so that a leg runs from the inner line over the front, the outside and the back. The
    sheet's axis u = 0.5 is the body's mirror plane: on a symmetric mesh, mirroring the body is
    `map.flip(-1)`. The body's left is at u > 0.5. Raises InputError naming the part that is no disk or tube.
    """
    faces = body.mesh.faces.numpy()
    mirror = mirrored_vertices(body)
    labels = _part_labels(body, mirror)
    torso = labels == TORSO
    loops = {name: _rings(faces[labels == part], faces[torso], name) for name, part in LIMB_LABELS.items()}
    neck = _neck(faces[torso], loops)

    frontal = vertex_normals(body.mesh.vertices, body.mesh.faces)[:, 1].abs().double().numpy()
    torso_cost = _edge_costs(body, faces[torso], frontal)
    seams: dict[str, np.ndarray] = {}
    for side in ("left", "right"):
        if side == "right" and mirror is not None:
            seams |= {name.replace("left", "right"): mirror[path] for name, path in seams.items()}
            continue
        arm, leg = loops[f"{side} arm"], loops[f"{side} leg"]
        shoulder, hip = np.intersect1d(arm[0], faces[torso]), np.intersect1d(leg[0], faces[torso])
        name = f"{side} shoulder"
        seams[name] = cheapest_path(faces[torso], torso_cost, neck, shoulder, name)
        name = f"{side} flank"
        seams[name] = cheapest_path(faces[torso], torso_cost, shoulder, hip, name)
        for limb in ("arm", "leg"):
            name = f"{side} {limb}"
            limb_faces = faces[labels == LIMB_LABELS[name]]
            cost = _edge_costs(body, limb_faces, _off_seam(body, loops[name], limb))
            seams[name] = cheapest_path(limb_faces, cost, *loops[name], name)
    crotch = cheapest_path(
        faces[torso],
        torso_cost,
        np.intersect1d(loops["left leg"][0], faces[torso]),
        np.intersect1d(loops["right leg"][0], faces[torso]),
        "crotch",
    )
    seams["crotch"] = crotch if mirror is None else _mirrored_path(crotch, mirror)
    cut = np.concatenate([path_edges(path) for path in seams.values()])
    labels[torso] = _front_and_back(body, faces[torso], cut)
    labels = _smooth_borders(labels, faces)
    return lay_out(
        body.mesh.vertices,
        body.mesh.faces,
        torch.from_numpy(labels),
        _charts(body, labels, seams),
        torch.from_numpy(np.concatenate([path_edges(seams[name]) for name in LIMB_LABELS])),
        margin=CHART_MARGIN,
    )


def load_body_layout() -> Layout:
    """Read the layout of the body that ships with the package, shared by all bodies of its topology."""
    return load_layout(Path(str(resources("uvcloth") / "data" / "layout.npz")))


def mirrored_vertices(body: Body, tolerance: float = 1e-3) -> np.ndarray | None:
    """Partner of each vertex (V,) across x = 0, or None if the mesh or its faces are not symmetric.

    tolerance: metres between a vertex and the mirror image of its partner.
    """
    points, faces = body.mesh.vertices.numpy(), body.mesh.faces.numpy()
    distance, partner = cKDTree(points * [-1, 1, 1]).query(points)
    if distance.max() > tolerance or (partner[partner] != np.arange(len(points))).any():
        return None
    if set(map(frozenset, faces.tolist())) != set(map(frozenset, partner[faces].tolist())):
        return None
    return partner


def _part_labels(body: Body, mirror: np.ndarray | None) -> np.ndarray:
    """Part of each face (F,), each part in one piece with smooth borders, the right side as the left."""
    regions, sides, faces = body.regions.numpy(), body.sides.numpy(), body.mesh.faces.numpy()
    labels = np.full(len(faces), PRUNED)
    labels[regions == REGIONS.index("torso")] = TORSO
    for limb, inner, outer in (("arm", "upper_arm", "forearm"), ("leg", "thigh", "calf")):
        on_limb = np.isin(regions, [REGIONS.index(inner), REGIONS.index(outer)])
        labels[on_limb & (sides > 0)] = LIMB_LABELS[f"left {limb}"]
        labels[on_limb & (sides < 0)] = LIMB_LABELS[f"right {limb}"]
    if mirror is not None:
        labels = _mirrored_labels(labels, body, mirror)
    labels = _smooth_borders(labels, faces)
    for part in (TORSO, *LIMB_LABELS.values()):
        rows = np.flatnonzero(labels == part)
        if len(rows):
            labels[np.delete(rows, largest_piece(faces[rows]))] = PRUNED
    return labels


def _smooth_borders(labels: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Labels (F,) in which a face that meets its own part along only one edge goes to the part around it.

    Such a face would have all its corners on the rim of its chart, where no texel sees it.
    """
    neighbours = _face_neighbours(faces)
    for turn in range(20):
        around = np.where(neighbours >= 0, labels[neighbours], PRUNED)
        agreed = np.where(around[:, 0] == around[:, 2], around[:, 0], around[:, 1])
        single = (agreed != labels) & ((around == agreed[:, None]).sum(1) >= 2)
        # One direction at a time, or two neighbours of that kind would change places for ever.
        labels = np.where(single & ((agreed > labels) == turn % 2), agreed, labels)
    return labels


def _mirrored_labels(labels: np.ndarray, body: Body, mirror: np.ndarray) -> np.ndarray:
    """Labels (F,) in which faces of the right half have the part of their partners on the left."""
    faces = body.mesh.faces.numpy()
    order = np.lexsort(np.sort(faces, axis=1).T)
    partner = np.empty(len(faces), dtype=np.int64)
    partner[order] = np.lexsort(np.sort(mirror[faces], axis=1).T)
    swap = np.arange(-1, 7)
    for limb in ("arm", "leg"):
        left, right = LIMB_LABELS[f"left {limb}"], LIMB_LABELS[f"right {limb}"]
        swap[[left + 1, right + 1]] = right, left
    middle = body.mesh.vertices.numpy()[faces, 0].mean(1)
    return np.where(middle < 0, swap[labels[partner] + 1], labels)


def _face_neighbours(faces: np.ndarray) -> np.ndarray:
    """The face across each edge (F, 3), -1 at a boundary."""
    pairs = face_pairs(torch.from_numpy(faces)).numpy()
    directed = np.concatenate([pairs, pairs[:, ::-1]])
    directed = directed[np.argsort(directed[:, 0], kind="stable")]
    slot = np.arange(len(directed)) - np.searchsorted(directed[:, 0], directed[:, 0])
    neighbours = np.full((len(faces), 3), -1)
    neighbours[directed[:, 0], slot] = directed[:, 1]
    return neighbours


def _rings(limb: np.ndarray, torso: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """The two rings of a limb: the one at the torso, and the longest of the others."""
    loops = boundary_loops(limb) if len(limb) else []
    joins = [bool(np.isin(loop, torso).any()) for loop in loops]
    if True not in joins or False not in joins:
        raise InputError(f"{name}: this part of the body is not a tube between the torso and a free end")
    return loops[joins.index(True)], loops[joins.index(False)]


def _neck(torso: np.ndarray, loops: dict[str, tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """The torso's longest ring that belongs to no limb."""
    limbs = np.concatenate([ring for rings in loops.values() for ring in rings])
    free = [loop for loop in boundary_loops(torso) if not np.isin(loop, limbs).all()]
    if not free:
        raise InputError("torso: the mesh is not open at the neck")
    return free[0]


def _edge_costs(body: Body, faces: np.ndarray, price: np.ndarray) -> np.ndarray:
    """Length of each edge times the mean price (V,) of its ends: (3F,)."""
    edges, _ = edges_of(faces)
    points = body.mesh.vertices.double().numpy()
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    return length * (SEAM_LENGTH_COST + price[edges].mean(1))


def _off_seam(body: Body, rings: tuple[np.ndarray, np.ndarray], limb: str) -> np.ndarray:
    """One minus the cosine of normals and the seam's side (V,): 0 underneath an arm or inside a leg."""
    points = body.mesh.vertices.double().numpy()
    normals = vertex_normals(body.mesh.vertices, body.mesh.faces).double().numpy()
    top, end = points[rings[0]].mean(0), points[rings[1]].mean(0)
    axis = (end - top) / np.linalg.norm(end - top)
    inwards = np.array([-np.sign(top[0]), 0.0, -1.0 if limb == "arm" else 0.0])
    inwards -= (inwards @ axis) * axis
    return 1.0 - normals @ (inwards / np.linalg.norm(inwards))


def _mirrored_path(path: np.ndarray, mirror: np.ndarray) -> np.ndarray:
    """Path whose second half is the mirror image of its first."""
    following = np.append(path[1:], path[-1])
    crossing = int(np.argmax((mirror[path] == path) | (mirror[path] == following)))
    half = path[: crossing + 1]
    back = mirror[half][::-1]
    return np.concatenate([half, back[1:] if back[0] == half[-1] else back])


def _front_and_back(body: Body, torso: np.ndarray, cut: np.ndarray) -> np.ndarray:
    """Divide the torso along the seams: FRONT, BACK or PRUNED for each of its faces."""
    pieces = face_components(torso, edge_keys(cut, int(torso.max()) + 1))
    sizes = np.bincount(pieces)
    if len(sizes) < 2:
        raise InputError("torso: the seams do not divide its front from its back")
    depth = body.mesh.vertices.numpy()[torso, 1].mean(1)
    large = sorted(np.argsort(sizes)[-2:], key=lambda piece: depth[pieces == piece].mean())
    return np.select([pieces == large[0], pieces == large[1]], [FRONT, BACK], PRUNED)


def _charts(body: Body, labels: np.ndarray, seams: dict[str, np.ndarray]) -> list[Chart]:
    """Charts with their corners, and rectangles of areas in proportion to the surface."""
    points, faces = body.mesh.vertices.double().numpy(), body.mesh.faces.numpy()
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    face_area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    area = {part: float(face_area[labels == part].sum()) for part in range(1, 7)}
    arms, legs = (area[left] + area[left + 1] for left in (LEFT_ARM, LEFT_LEG))
    torso = area[FRONT] + area[BACK]
    column = (arms + legs) / (arms + legs + torso) / 2
    knee = legs / (arms + legs)
    waist = area[BACK] / torso
    left, right = (1 - column, 1.0), (0.0, column)
    sheet = {
        "left arm": (left[0], knee, left[1], 1.0),
        "right arm": (right[0], knee, right[1], 1.0),
        "left leg": (left[0], 0.0, left[1], knee),
        "right leg": (right[0], 0.0, right[1], knee),
    }
    charts = []
    for name, part in LIMB_LABELS.items():
        top, end = int(seams[name][0]), int(seams[name][-1])
        charts.append(Chart(name, part, (end, end, top, top), sheet[name]))
    ends = {
        side: (int(seams[f"{side} shoulder"][-1]), int(seams[f"{side} flank"][-1]))
        for side in ("left", "right")
    }
    (left_arm, left_leg), (right_arm, right_leg) = ends["left"], ends["right"]
    middle = (column, 1 - column)
    charts.append(
        Chart(
            "torso front",
            FRONT,
            (right_leg, left_leg, left_arm, right_arm),
            (middle[0], waist, middle[1], 1.0),
        )
    )
    charts.append(
        Chart(
            "torso back", BACK, (left_leg, right_leg, right_arm, left_arm), (middle[0], 0.0, middle[1], waist)
        )
    )
    return charts


def layout_of(body: Body) -> Layout:
    """Layout of a body: the one that all bodies of the default topology share, or one of its own."""
    default = load_body()
    return load_body_layout() if torch.equal(default.mesh.faces, body.mesh.faces) else body_layout(body)
