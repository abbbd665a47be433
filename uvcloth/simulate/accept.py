"""Whether a simulated sequence may be trained on."""

from dataclasses import replace

import torch
from torch import Tensor
from torch.nn.functional import normalize

from rasterize.raycast import cast_rays, closest_points
from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.mesh import face_normals, unique_edges
from uvcloth.physics.contact import BodySurface, calm_vertices, inside_vertices
from uvcloth.simulate.sequence import Sequence
from uvcloth.skinning import skin

MOST_INSIDE = 0.5
"""Percent of vertices that may be inside the collider, averaged over the frames that count."""

MOST_STRETCH = 20.0
"""Times its rest length that no edge may reach."""


MOST_PASSED = 0.2
"""Percent of vertices that may have gone through their limb, averaged over the frames that count."""

THROUGH = 0.7
"""Share of a limb's thickness at rest beyond which cloth lies on its other side."""

ASIDE = 0.06
"""Metres along the skin beyond which cloth has slid away rather than gone through."""


def examine(sequence: Sequence, body: Body) -> tuple[Sequence, str | None]:
    """The sequence with what was measured in its metadata, and why it is refused, if so.

    inside_percent: of the vertices inside the collider (the body without forearms and hands), not counting
    places where the body intersects itself and parts that may not touch them; inside_percent_raw counts all.
    passed_percent: of the vertices on the other side of the limb that they were put on, which nothing else
    notices.
    """
    frames, vertices = len(sequence.vertices), sequence.vertices
    if not torch.isfinite(vertices).all():
        return sequence, f"frame {frames - 1}: a vertex is not a finite number"
    edges = unique_edges(sequence.faces)
    rest = (sequence.rest[edges[:, 0]] - sequence.rest[edges[:, 1]]).norm(dim=-1)
    ratio = ((vertices[:, edges[:, 0]] - vertices[:, edges[:, 1]]).norm(dim=-1) / rest).amax(1)
    if float(ratio.max()) > MOST_STRETCH:
        return sequence, f"frame {int(ratio.argmax())}: an edge is {float(ratio.max()):.1f} times its length"
    collider = make_collider(body)
    skinned = skin(body.mesh.vertices, body.weights, sequence.transforms)
    passed = _passed_percent(sequence, body, skinned)
    posed = collider.vertices(skinned)
    surface = BodySurface(posed[0], collider.faces)
    touches = collider.touches(sequence.rest, body.mesh.vertices)
    each = torch.arange(len(sequence.rest))
    raw, outside_conflict = [], []
    for frame in range(sequence.settling, frames):
        surface.update(posed[frame])
        inside, found = inside_vertices(vertices[frame], surface)
        raw.append(100.0 * float(inside.float().mean()))
        inside &= touches[collider.owners[found.faces], each] & ~calm_vertices(found, surface)
        outside_conflict.append(100.0 * float(inside.float().mean()))
    share = sum(outside_conflict) / max(1, len(outside_conflict))
    metadata = {
        **sequence.metadata,
        "inside_percent": round(share, 4),
        "inside_percent_raw": round(sum(raw) / max(1, len(raw)), 4),
        "passed_percent": round(passed, 4),
    }
    reason = None
    if share > MOST_INSIDE:
        reason = f"{share:.2f} % of the vertices are inside the body"
    elif passed > MOST_PASSED:
        reason = f"{passed:.2f} % of the vertices went through their limb"
    return replace(sequence, metadata=metadata), reason


def _passed_percent(sequence: Sequence, body: Body, skinned: Tensor) -> float:
    """Percent of vertices beyond the skin point they lay on by most of the limb's thickness there."""
    mesh = body.mesh
    hung = closest_points(sequence.rest, mesh.vertices, mesh.faces)
    points = hung.carry(mesh.vertices, mesh.faces)
    outward = normalize(face_normals(mesh.vertices, mesh.faces)[hung.face], dim=-1)
    limb = cast_rays(
        points - 1e-3 * outward, -outward, mesh.vertices, mesh.faces, max_distance=1.0, both_ways=False
    )
    corners = mesh.faces[hung.face]
    share = []
    for posed, vertices in zip(
        skinned[sequence.settling :], sequence.vertices[sequence.settling :], strict=True
    ):
        a, b, c = (posed[corners[:, corner]] for corner in range(3))
        normal = normalize(torch.linalg.cross(b - a, c - a), dim=-1)
        away = vertices - hung.carry(posed, mesh.faces)
        depth = -(away * normal).sum(-1)
        aside = (away + depth[:, None] * normal).norm(dim=-1)
        share.append(float(((depth > THROUGH * limb.distance) & (aside < ASIDE)).float().mean()))
    return 100.0 * sum(share) / max(1, len(share))
