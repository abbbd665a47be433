"""Baked outfits without some of their garments, which then cost nothing.

What is left is as it was baked: garments that lay over one that is gone keep the shape that they had over it.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvcloth.player.sections import pack, row_starts, unpack

Rows = NDArray[np.intp]

OF_CAGES = (
    *("outfit.hold", "cages.rest", "cloth.touches", "cloth.crossed"),
    *("particles.mass", "particles.weight", "particles.thickness", "particles.friction"),
)
OF_CAGE_FACES = (
    *("sheet.owned", "membrane.inverse", "membrane.area"),
    *("membrane.shear", "membrane.spread", "membrane.damping", "membrane.pressure"),
)
OF_HINGES = ("hinges.stiffness", "hinges.rest", "hinges.floors")
OF_POINTS = ("points.rest", "fine.touches", "fine.thickness", "layers.touches")
"""Sections with a row for each vertex or face of the cages, hinge of these, and point of the garments."""

WRINKLED = "wrinkles.garments"
"""Section with the garments that have wrinkles, each of which has sections of its own."""


def without_others(content: bytes, worn: Sequence[int]) -> bytes:
    """An outfit that the runtime has read, of which only some garments, in their order, are left."""
    sections, steps = unpack(content)
    old = dict(sections)
    kept = np.zeros(len(old["garments.starts"]) - 1, bool)
    kept[list(worn)] = True
    garment_of_point = _owners(old["garments.starts"])
    garment_of_vertex = _garments_of_cages(old, garment_of_point)
    points = np.flatnonzero(kept[garment_of_point])
    vertices = np.flatnonzero(kept[garment_of_vertex])

    def rows_of(name: str, garments: NDArray[Any]) -> Rows:
        return np.flatnonzero(kept[garments[old[name][:, 0]]])

    faces, edges = (rows_of(name, garment_of_vertex) for name in ("sheet.faces", "sheet.edges"))
    hinges, fine = rows_of("hinges.corners", garment_of_vertex), rows_of("fine.faces", garment_of_point)
    for names, rows in (
        (OF_CAGES, vertices),
        (OF_CAGE_FACES, faces),
        (OF_HINGES, hinges),
        (OF_POINTS, points),
    ):
        sections |= {name: old[name][rows] for name in names}
    for name, rows, left in (
        ("sheet.faces", faces, vertices),
        ("sheet.edges", edges, vertices),
        ("sheet.face_edges", faces, edges),
        ("hinges.corners", hinges, vertices),
        ("fine.faces", fine, points),
    ):
        sections[name] = np.searchsorted(left, old[name][rows])
    for name, values, rows in (
        ("cages", "joints", vertices),
        ("points", "joints", points),
        ("follow", "cage", points),
    ):
        sections |= _jagged(old, name, values, rows)
    sections["follow.cage"] = np.searchsorted(vertices, sections["follow.cage"])
    pieces = _owners(old["sheet.starts"])
    piece_garments = garment_of_vertex[old["sheet.faces"][old["sheet.starts"][:-1], 0]]
    left_pieces = np.flatnonzero(kept[piece_garments])
    sections["sheet.starts"] = row_starts(np.bincount(pieces)[left_pieces])
    sections["sheet.apart"] = old["sheet.apart"][np.ix_(left_pieces, left_pieces)]
    shown = kept[_owners(old["outfit.shown_starts"])]
    sections["outfit.shown"] = np.searchsorted(points, old["outfit.shown"][shown])
    for name in ("garments.starts", "outfit.shown_starts"):
        sections[name] = row_starts(np.diff(old[name])[kept])
    pairs = kept[old["layers.outer"]] & kept[old["layers.inner"]]
    for name in ("layers.outer", "layers.inner"):
        sections[name] = np.searchsorted(np.flatnonzero(kept), old[name][pairs])
    if WRINKLED in old:
        sections, steps = _with_wrinkles(sections, steps, kept)
    return pack(sections, steps, compressed=True)


def _with_wrinkles(
    sections: dict[str, NDArray[Any]], steps: dict[str, float], kept: NDArray[np.bool_]
) -> tuple[dict[str, NDArray[Any]], dict[str, float]]:
    """Sections and steps with the wrinkles of kept garments alone, without a network if there are none."""
    before = sections[WRINKLED]
    left = np.flatnonzero(kept[before])
    prefixes: dict[str, str | None] = {f"wrinkles{index}": None for index in range(len(before))}
    prefixes |= {f"wrinkles{index}": f"wrinkles{place}" for place, index in enumerate(left.tolist())}
    prefixes["wrinkles"] = "wrinkles" if len(left) else None

    def renamed(values: dict[str, Any]) -> dict[str, Any]:
        names = {name: name.partition(".") for name in values}
        new = {name: prefixes.get(prefix, prefix) for name, (prefix, _, _) in names.items()}
        return {f"{new[name]}.{names[name][2]}": value for name, value in values.items() if new[name]}

    sections, steps = renamed(sections), renamed(steps)
    if len(left):
        sections[WRINKLED] = np.searchsorted(np.flatnonzero(kept), before[left])
    return sections, steps


def _garments_of_cages(sections: dict[str, NDArray[Any]], garment_of_point: Rows) -> Rows:
    """The garment of each vertex of the cages: of the points around it, or of its neighbours."""
    garments = np.full(len(sections["cages.rest"]), -1)
    garments[sections["follow.cage"]] = np.repeat(garment_of_point, np.diff(sections["follow.starts"]))
    faces = sections["sheet.faces"]
    while (garments[faces] < 0).any():
        np.maximum.at(garments, faces, garments[faces].max(1, keepdims=True))
    return np.maximum(garments, 0)


def _jagged(sections: dict[str, NDArray[Any]], name: str, values: str, rows: Rows) -> dict[str, NDArray[Any]]:
    """Some rows of a jagged array, and of its weights, of which the last one of each row is not there."""
    starts = sections[f"{name}.starts"]
    counts = np.diff(starts)
    shares = np.maximum(counts - 1, 0)
    return {
        f"{name}.starts": row_starts(counts[rows]),
        f"{name}.{values}": sections[f"{name}.{values}"][
            np.isin(np.repeat(np.arange(len(counts)), counts), rows)
        ],
        f"{name}.weights": sections[f"{name}.weights"][
            np.isin(np.repeat(np.arange(len(counts)), shares), rows)
        ],
    }


def _owners(starts: NDArray[Any]) -> Rows:
    """The row that each element of a jagged array is of."""
    return np.repeat(np.arange(len(starts) - 1), np.diff(starts))
