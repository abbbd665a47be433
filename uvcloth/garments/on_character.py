"""The frame of reference of a character's file: its axes, its unit and its pose."""

from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.characters.rig import RiggedCharacter
from uvcloth.garments.garment import Garment
from uvcloth.garments.pose import posed_body
from uvcloth.geometry.skinning import skin


@dataclass(frozen=True)
class CharacterFrame:
    """Transforms of a character's file: its points to the body, and the body from rest to the file's pose.

    axes: (3, 3) turn and scale to metres, Z up. transforms: (J, 3, 4) of our joints.
    """

    axes: Tensor
    transforms: Tensor

    @classmethod
    def of(cls, rigged: RiggedCharacter) -> "CharacterFrame":
        """The frame of the file that a character was read from."""
        turns = rigged.rested[..., :3].double().inverse()
        shifts = -(turns @ rigged.rested[..., 3:].double())
        return cls(rigged.axes, torch.cat([turns, shifts], dim=2).float())

    def posed(self, body: Body) -> Body:
        """The character's body in the pose of the file."""
        return posed_body(body, self.transforms)

    def to_body(self, points: Tensor) -> Tensor:
        """Points (N, 3) of the file on the posed body: float32, metres, Z up."""
        return (points.double() @ self.axes.double().T).float()

    def from_rest(self, garment: Garment) -> Tensor:
        """Vertices (N, 3) of a garment at rest on the body, as the file would have them."""
        posed = skin(garment.mesh.vertices, garment.smooth_weights, self.transforms[None])[0]
        return (posed.double() @ self.axes.double().inverse().T).float()
