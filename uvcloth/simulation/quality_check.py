"""Quality check: measures of a simulated clip, and the limits within which it may be trained on."""

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.collider import make_collider
from uvcloth.bodies.posing import posed_skin
from uvcloth.dataset.clip import SimulatedClip, SimulatedGarment
from uvcloth.garments.garment import Garment
from uvcloth.geometry.mesh import unique_edges, weld
from uvcloth.geometry.skinning import skin
from uvcloth.physics.obstacle import Obstacle, Skin
from uvcloth.physics.self_intersection import crossing_edges_percent
from uvcloth.simulation.hems import unsupported_hem
from uvcloth.simulation.limbs import limbs_left_percent

MAX_INSIDE_PERCENT = 0.5
"""Percent of vertices that may be inside the collider, averaged over the scored frames."""

MAX_STRETCH = 20.0
"""Multiple of its rest length that no edge may exceed."""

MAX_LEFT_PERCENT = 5.0
"""Percent of the frames in which a bone may stick through the cloth around it, or a limb leave its cuff."""

MAX_CROSSING_PERCENT = 5.0
"""Percent of the edges that may run through the garment itself, averaged over the scored frames."""


def examine(clip: SimulatedClip, garments: Sequence[Garment], body: Body) -> tuple[SimulatedClip, str | None]:
    """Examine a clip: returns it with measures in the metadata of each garment, and the reasons of a refusal.

    Where there are several garments, the reasons give their names. The measures:

    inside_percent: of the vertices inside a part of the collider that they may touch, but for those squeezed
    between two such parts.
    left_percent: of the frames in which a bone sticks through the cloth around it, or a limb is out of the
    cuff that it passes at rest. Cloth that has come off its limb lies outside of everything, which no other
    measure shows.
    crossing_percent: of the edges that run through a face of the garment.

    An unsupported hem is refused too (`unsupported_hem`).
    """
    pairs = zip(clip.garments, garments, strict=True)
    examined = [_examine(clip, simulated, garment, body) for simulated, garment in pairs]
    reasons = [
        reason if len(examined) == 1 else f"{simulated.name}: {reason}"
        for simulated, reason in examined
        if reason is not None
    ]
    return replace(clip, garments=tuple(each for each, _ in examined)), "; ".join(reasons) or None


def _examine(
    clip: SimulatedClip, simulated: SimulatedGarment, garment: Garment, body: Body
) -> tuple[SimulatedGarment, str | None]:
    """Examine a garment of a clip: returns it with its measures, and the reason of a refusal."""
    frames, vertices = len(simulated.vertices), simulated.vertices
    if not torch.isfinite(vertices).all():
        return simulated, f"frame {frames - 1}: a vertex is not a finite number"
    edges = unique_edges(simulated.faces)
    rest = (simulated.rest[edges[:, 0]] - simulated.rest[edges[:, 1]]).norm(dim=-1)
    ratio = ((vertices[:, edges[:, 0]] - vertices[:, edges[:, 1]]).norm(dim=-1) / rest).amax(1)
    if float(ratio.max()) > MAX_STRETCH:
        return simulated, f"frame {int(ratio.argmax())}: an edge is {float(ratio.max()):.1f} times its length"
    obstacle = Obstacle(make_collider(body), body.mesh.vertices)
    contact = obstacle.contact_garment(simulated.rest)
    scored = slice(clip.warm_up, None)
    vertices, transforms = vertices[scored], clip.transforms[scored]
    left = limbs_left_percent(
        vertices, simulated.rest, simulated.faces, transforms, body.skeleton, contact.touches
    )
    posed = posed_skin(body, transforms)
    inside = _mean(obstacle.inside_percent(vertices, contact, posed))
    crossing = _mean(crossing_edges_percent(vertices, weld(simulated.rest)[simulated.faces]))
    skinned = skin(simulated.rest, garment.smooth_weights, transforms)

    def skin_at(frame: int) -> Skin:
        obstacle.update(posed[frame])
        return obstacle.skin(vertices[frame], contact)

    raised = unsupported_hem(vertices, skinned, simulated.rest, simulated.faces, clip.fps, skin_at)
    metadata = {
        **simulated.metadata,
        "inside_percent": round(inside, 4),
        "left_percent": round(left, 4),
        "crossing_percent": round(crossing, 4),
    }
    reason = None
    if left > MAX_LEFT_PERCENT:
        reason = f"a limb has left its cloth in {left:.0f} % of the frames"
    elif inside > MAX_INSIDE_PERCENT:
        reason = f"{inside:.2f} % of the vertices are inside the body"
    elif crossing > MAX_CROSSING_PERCENT:
        reason = f"{crossing:.1f} % of the edges run through the garment itself"
    elif raised is not None:
        frame, rise = raised
        reason = (
            f"frame {clip.warm_up + frame}: a hem stays {100 * rise:.0f} cm above the skinned one for a "
            "second, without support"
        )
    return replace(simulated, metadata=metadata), reason


def _mean(percent: Tensor) -> float:
    return float(percent.mean()) if len(percent) else 0.0
