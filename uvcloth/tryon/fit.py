"""Pose of a body, and its place before the camera, that explain the keypoints of a photograph."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.bodies.body import Body
from uvcloth.bodies.posing import posed_skin
from uvcloth.errors import InputError
from uvcloth.geometry.rotations import from_euler
from uvcloth.geometry.skeleton import joint_transforms, world_rotations
from uvcloth.motion.clip import Clip
from uvcloth.rendering.render import Camera
from uvcloth.tryon.keypoints import Keypoints
from uvcloth.tryon.landmarks import landmarks, posed_landmarks
from uvcloth.tryon.overlap import Overlap, overlap_of
from uvcloth.tryon.prior import PosePrior, pose_prior, rotations_of

HEADINGS = 8
"""Directions that the person may face at the start of the search, all around."""

STEPS, RATE = 250, 0.1
"""Steps of Adam, and its first rate, which falls to zero as a cosine."""

NOISE = 0.03
"""Standard deviation of a keypoint over the length of the torso."""

OUTLYING = 3.0
"""Deviations from which the cost of a keypoint grows linearly instead of by the square."""

WORST = 0.15
"""Greatest mean distance of fitted keypoints over the length of the torso."""


@dataclass(frozen=True)
class FittedPerson:
    """A body as the person of a photograph stands before the camera.

    clip: one frame, the body on the floor, its root above the origin. camera: level, as it took the
    photograph. joints: (K, 2) pixels of the body's keypoints. error: mean distance from the keypoints of the
    photograph, pixels; relative: over the length of the torso. cost: negative logarithm of the likelihood.
    """

    clip: Clip
    camera: Camera
    joints: Tensor
    error: float
    relative: float
    cost: float


def fit_person(keypoints: Keypoints, body: Body, size: tuple[int, int], view: float) -> FittedPerson:
    """Fit pose, heading and place of a body to keypoints, from HEADINGS starts side by side.

    The likeliest pose is wanted: distances of keypoints count by their confidence, poses as the prior has
    them, and arms inside the torso by their depth. At each start the pose is the one of the clips that fits
    best from that side.
    size: (width, height) of the photograph. view: vertical field of view in degrees.
    """
    search = _Search.of(keypoints, body, size, view)
    headings = torch.arange(HEADINGS) * (2 * math.pi / HEADINGS)
    poses, place = search.starts(headings)
    unknowns = [search.prior.whitened(poses), headings[:, None].clone(), place]
    for unknown in unknowns:
        unknown.requires_grad_(True)
    optimizer = torch.optim.Adam(unknowns, RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
    for _ in range(STEPS):
        optimizer.zero_grad()
        search.costs(*unknowns).sum().backward()
        optimizer.step()
        schedule.step()
    with torch.no_grad():
        costs = search.costs(*unknowns)
        best = int(costs.argmin())
        whitened, heading, place = (each[best : best + 1] for each in unknowns)
        return search.person(body, whitened, heading, place, float(costs[best]))


def require_fit(person: FittedPerson, source: object) -> None:
    """Raise InputError naming the source of the keypoints if the body does not explain them."""
    if not person.relative <= WORST:
        raise InputError(
            f"{source}: no pose of the body fits these keypoints: they are missed by {person.error:.0f} "
            f"pixels on average, {person.relative:.0%} of the torso, expected at most {WORST:.0%}"
        )


@dataclass(frozen=True)
class _Search:
    """Data of a search. joints, points: of the landmarks. middle: (2,) of the picture, and focal, pixels."""

    keypoints: Keypoints
    body: Body
    prior: PosePrior
    overlap: Overlap
    joints: Tensor
    points: Tensor
    middle: Tensor
    focal: float
    view: float

    @classmethod
    def of(cls, keypoints: Keypoints, body: Body, size: tuple[int, int], view: float) -> "_Search":
        joints, points = landmarks(body, keypoints.names)
        focal = size[1] / (2 * math.tan(math.radians(view / 2)))
        middle = torch.tensor(size) / 2
        return cls(keypoints, body, pose_prior(body), overlap_of(body), joints, points, middle, focal, view)

    def starts(self, headings: Tensor) -> tuple[Tensor, Tensor]:
        """Poses (B, 3 J) and places (B, 3), as `costs` has them, of the best pose of the clips for each
        heading, seen from far away.
        """
        poses = self.prior.poses
        still = torch.zeros(len(poses), 3)
        marks = posed_landmarks(self.joints, self.points, self._transforms(poses, still[:, :1], still))
        turned = marks @ from_euler("z", headings[:, None]).mT[:, None]  # (B, M, K, 3)
        flat = turned[..., [0, 2]] * torch.tensor([1.0, -1.0])
        share = (self.keypoints.confidences / self.keypoints.confidences.sum())[:, None]
        centre = (share * self.keypoints.points).sum(0)
        away, wanted = flat - (share * flat).sum(-2, keepdim=True), self.keypoints.points - centre
        scale = (share * away * wanted).sum((-2, -1)) / (share * away.square()).sum((-2, -1))
        scale = scale.clamp(min=1e-3 * self.keypoints.torso)
        missed = (share * (scale[..., None, None] * away - wanted).square()).sum((-2, -1))
        best = missed.argmin(1)
        row = torch.arange(len(headings))
        scale = scale[row, best]
        root = centre - scale[:, None] * (share * flat[row, best]).sum(-2)
        place = torch.cat(
            [(root - self.middle) / self.keypoints.torso, (self.focal / scale).log()[:, None]], 1
        )
        return poses[best], place

    def costs(self, whitened: Tensor, heading: Tensor, place: Tensor) -> Tensor:
        """Costs (B,) of whitened poses, headings (B, 1) radians, and places of the root.

        place: (B, 3), pixels from the middle of the picture over the torso's, and logarithm of the depth.
        """
        poses = self.prior.poses_of(whitened)
        transforms = self._transforms(poses, heading, self._root(place))
        missed = (self._pixels(transforms) - self.keypoints.points).norm(dim=-1)
        deviations = missed / (NOISE * self.keypoints.torso * OUTLYING)
        robust = OUTLYING**2 * ((1 + deviations.square()).sqrt() - 1)
        likely = (self.keypoints.confidences * robust).sum(-1) + whitened.square().sum(-1) / 2
        return likely + self.overlap.costs(transforms)

    def person(
        self, body: Body, whitened: Tensor, heading: Tensor, place: Tensor, cost: float
    ) -> FittedPerson:
        """The person of one pose and place, put on the floor."""
        poses, root = self.prior.poses_of(whitened), self._root(place)
        rotations, transforms = self._rotations(poses, heading), self._transforms(poses, heading, root)
        joints = self._pixels(transforms)[0]
        error = float((joints - self.keypoints.points).norm(dim=-1).mean())
        floor = posed_skin(body, transforms)[..., 2].min()
        shift = torch.stack([root[0, 0], root[0, 1], floor])
        eye = (-shift).tolist()
        return FittedPerson(
            clip=Clip("photograph", body.skeleton, rotations, root - shift, fps=30.0),
            camera=Camera((eye[0], eye[1], eye[2]), (eye[0], eye[1] + 1.0, eye[2]), self.view),
            joints=joints,
            error=error,
            relative=error / self.keypoints.torso,
            cost=cost,
        )

    def _rotations(self, poses: Tensor, heading: Tensor) -> Tensor:
        """World rotations (B, J, 3, 3) of poses with headings (B, 1)."""
        world = world_rotations(self.body.skeleton.parents, rotations_of(poses))
        return from_euler("z", heading)[:, None] @ world

    def _transforms(self, poses: Tensor, heading: Tensor, root: Tensor) -> Tensor:
        return joint_transforms(self.body.skeleton, self._rotations(poses, heading), root)

    def _root(self, place: Tensor) -> Tensor:
        """Positions (B, 3) m of the root before a camera at the origin that looks along Y."""
        depth = place[:, 2].exp()
        across, down = (place[:, :2] * (self.keypoints.torso / self.focal)).unbind(1)
        return depth[:, None] * torch.stack([across, torch.ones_like(down), -down], dim=1)

    def _pixels(self, transforms: Tensor) -> Tensor:
        """Pixels (B, K, 2) of the landmarks."""
        x, y, z = posed_landmarks(self.joints, self.points, transforms).unbind(-1)
        scale = self.focal / y.clamp(min=0.05)
        return self.middle + scale[..., None] * torch.stack([x, -z], dim=-1)
