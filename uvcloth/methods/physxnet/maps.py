"""Values on PhysXNet's maps: motion and pose of the body, offsets of a template; and vertices from them."""

from collections.abc import Callable

import torch
from torch import Tensor

from rasterize.gather import gather
from uvcloth.geometry.rotations import rotate, rotate_back
from uvcloth.geometry.skinning import seen_from_root, skin_frames
from uvcloth.geometry.units import FREE_FALL
from uvcloth.methods.physxnet.config import PhysXNetConfig
from uvcloth.methods.physxnet.texels import BodyTexels, GarmentDecoder, TemplateTexels


def motion_values(
    config: PhysXNetConfig, texels: BodyTexels, velocity: Tensor, acceleration: Tensor, transforms: Tensor
) -> Tensor:
    """Velocity and acceleration of the texels' body points (eq. 6 and 7): (T, 6, P), or none, (T, 0, P).

    velocity, acceleration: (T, V, 3) m/s and m/s2. transforms: (T, J, 3, 4).
    """
    if not config.motion:
        return velocity.new_zeros(len(velocity), 0, len(texels.corners))
    v, a = texels.gather(velocity), texels.gather(acceleration)
    if config.acceleration == "specific_force":
        a = a - a.new_tensor(FREE_FALL)
    if config.frame == "body":
        _, frames = skin_frames(texels.points, texels.weights, transforms)
        v, a = rotate_back(frames, v), rotate_back(frames, a)
    return torch.cat([v, a], dim=-1).transpose(1, 2)


def pose_values(texels: BodyTexels, vertices: Tensor, transforms: Tensor) -> Tensor:
    """Positions of the texels' body points, seen from the root joint, against their rest: (T, 3, P), m.

    vertices: (T, V, 3). transforms: (T, J, 3, 4), the root joint first.
    """
    return (seen_from_root(texels.gather(vertices), transforms) - texels.points).transpose(1, 2)


def template_offsets(
    config: PhysXNetConfig,
    texels: BodyTexels,
    template: TemplateTexels,
    decoder: GarmentDecoder,
    *,
    vertices: Tensor,
    body_vertices: Tensor,
    transforms: Tensor,
) -> Tensor:
    """A template's simulated vertices as values of its offset map: (T, Q, 3), m (eq. 8, or local offsets).

    vertices: (T, N, 3). body_vertices: (T, V, 3). transforms: (T, J, 3, 4).
    """
    if config.anchor == "body":
        origins, frames = body_anchors(texels, template, body_vertices, transforms)
        offsets = template.gather(vertices) - origins
        return rotate_back(frames, offsets) if config.frame == "body" else offsets
    origins, frames = skin_frames(decoder.points, decoder.smooth_weights, transforms)
    offsets = vertices - origins
    return template.gather(rotate_back(frames, offsets) if config.frame == "body" else offsets)


def garment_vertices(
    config: PhysXNetConfig,
    texels: BodyTexels,
    template: TemplateTexels,
    decoder: GarmentDecoder,
    *,
    offsets: Tensor,
    body_vertices: Tensor,
    transforms: Tensor,
    sample: Callable[[Tensor], Tensor] | None = None,
) -> Tensor:
    """Decode a template's offsets (B, Q, 3) to the vertices (B, N, 3), m, of any garment (eq. 9).

    Anchored on the smooth LBS reference, a garment keeps its own rest shape and takes over the change
    sampled; anchored on the body, it follows the template's surface and keeps what it had beside it at rest.
    sample: what serves for `decoder.sample` where its gradient is wanted fast.
    """
    sample = sample or decoder.sample
    local = config.frame == "body"
    if config.anchor == "body":
        origins, frames = body_anchors(texels, template, body_vertices, transforms)
        surface = sample(origins + (rotate(frames, offsets) if local else offsets))
        _, turned = skin_frames(decoder.points, decoder.weights, transforms)
        return surface + rotate(turned, decoder.residual)
    origins, frames = skin_frames(decoder.points, decoder.smooth_weights, transforms)
    change = sample(offsets)
    return origins + (rotate(frames, change) if local else change)


def body_anchors(
    texels: BodyTexels, template: TemplateTexels, body_vertices: Tensor, transforms: Tensor
) -> tuple[Tensor, Tensor]:
    """Posed body points (B, Q, 3) of a template's texels, and the frames that turn with them (B, Q, 3, 3)."""
    rows = template.texels
    _, frames = skin_frames(texels.points[rows], texels.weights[rows], transforms)
    return gather(body_vertices, texels.corners[rows], texels.sheet.barycentrics[rows]), frames
