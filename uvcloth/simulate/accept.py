"""Whether a simulated sequence may be trained on."""

from dataclasses import replace

import torch

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.mesh import unique_edges
from uvcloth.physics.contact import BodySurface, inside_share
from uvcloth.simulate.sequence import Sequence
from uvcloth.skinning import skin

MOST_INSIDE = 0.5
"""Percent of vertices that may be inside the collider, averaged over the frames that count."""

MOST_STRETCH = 8.0
"""Times its rest length that no edge may reach."""


def examine(sequence: Sequence, body: Body) -> tuple[Sequence, str | None]:
    """The sequence with inside_percent and inside_percent_raw in its metadata, and why it is refused, if so.

    Inside means inside the collider (the body without forearms and hands), not counting places where the
    body intersects itself; the raw figure counts those too.
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
    posed = collider.vertices(skin(body.mesh.vertices, body.weights, sequence.transforms))
    surface = BodySurface(posed[0], collider.faces)
    raw, outside_conflict = [], []
    for frame in range(sequence.settling, frames):
        surface.update(posed[frame])
        everywhere, elsewhere = inside_share(vertices[frame], surface)
        raw.append(everywhere)
        outside_conflict.append(elsewhere)
    inside = sum(outside_conflict) / max(1, len(outside_conflict))
    metadata = {
        **sequence.metadata,
        "inside_percent": round(inside, 4),
        "inside_percent_raw": round(sum(raw) / max(1, len(raw)), 4),
    }
    reason = f"{inside:.2f} % of the vertices are inside the body" if inside > MOST_INSIDE else None
    return replace(sequence, metadata=metadata), reason
