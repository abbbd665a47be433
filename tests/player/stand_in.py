"""A runtime that skins its garments to the nearest joint of their vertices: what the tests of files play."""

import zlib
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from uvcloth.garments.garment import Outfit

MAGIC = b"STANDIN1"


def bake_outfit(outfit: "Outfit", config: Any) -> bytes:
    """Rest positions and strongest joints of every garment, with a checksum before them."""
    parts = [np.array([len(outfit.body.skeleton.names), len(outfit.garments)], "<i4").tobytes()]
    for garment in outfit.garments:
        parts.append(np.array([len(garment.mesh.vertices)], "<i4").tobytes())
        parts.append(garment.mesh.vertices.numpy().astype("<f4").tobytes())
        parts.append(garment.smooth_weights.argmax(1).numpy().astype("<i4").tobytes())
    content = b"".join(parts)
    return MAGIC + zlib.crc32(content).to_bytes(4, "little") + content


class StandInOutfit:
    """See `uvcloth.player.outfit.Outfit`."""

    def __init__(self, content: bytes) -> None:
        if content[:8] != MAGIC or zlib.crc32(content[12:]).to_bytes(4, "little") != content[8:12]:
            raise ValueError("the cloth is damaged")
        self.joints, count = map(int, np.frombuffer(content, "<i4", 2, 12))
        self.rest, self.owner, at = [], [], 20
        for _ in range(count):
            (size,) = np.frombuffer(content, "<i4", 1, at)
            self.rest.append(np.frombuffer(content, "<f4", 3 * size, at + 4).reshape(-1, 3))
            self.owner.append(np.frombuffer(content, "<i4", size, at + 4 + 12 * size))
            at += 4 + 16 * size
        self.garments = tuple(map(len, self.rest))


class StandInCloth:
    """See `uvcloth.player.outfit.Cloth`."""

    def __init__(self, outfit: StandInOutfit) -> None:
        self.outfit = outfit

    def start(self, joints: np.ndarray) -> None:
        assert joints.shape == (self.outfit.joints, 3, 4)
        self.joints = joints

    def step(self, joints: np.ndarray, seconds: float) -> None:
        assert seconds > 0
        self.start(joints)

    def vertices(self, garment: int) -> np.ndarray:
        moved = self.joints[self.outfit.owner[garment]]
        points = self.outfit.rest[garment].astype(np.float64)
        return np.asarray(np.einsum("nab,nb->na", moved[..., :3], points) + moved[..., 3])
