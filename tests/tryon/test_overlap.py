"""The cost of arms inside the torso."""

import torch

from uvcloth.bodies.body import load_body
from uvcloth.motion.clip import Clip
from uvcloth.tryon.overlap import overlap_of


def test_an_arm_in_the_torso_costs() -> None:
    """None at rest; much where the left forearm is moved into the middle of the trunk."""
    body = load_body()
    still = torch.eye(3).expand(1, len(body.skeleton.names), 3, 3)
    rest = Clip("rest", body.skeleton, still, body.skeleton.heads[:1], 30.0).transforms()
    inside = rest.clone()
    forearm = body.skeleton.names.index("LeftForeArm")
    inside[:, forearm, :, 3] += torch.tensor([0.0, 0.0, 0.4]) - body.skeleton.heads[forearm]
    costs = overlap_of(body).costs(torch.cat([rest, inside]))
    assert costs[0] < 0.5
    assert costs[1] > 10.0
