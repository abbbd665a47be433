"""Recorded garments as a method: they are played as they are, and finished as the method they come from."""

import pytest
import torch
from torch import Tensor

from evaluate.recorded import Recorded
from tests.evaluate.test_compare import capsule_body, motion, tube_garment
from uvcloth.bodies.body import Body
from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.templates import fit_template
from uvcloth.methods.lbs import LBSConfig, create_lbs
from uvcloth.methods.method import Method
from uvcloth.methods.physics.finish import Finished
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import PhysicsConfig
from uvcloth.rollouts.rollout import rollout

pytestmark = pytest.mark.usefixtures("coarse_pixels")

FPS = 30.0


def rolled(method: Method, outfit: Outfit, transforms: Tensor) -> Tensor:
    return torch.stack([frame.vertices[0] for frame in rollout(method, outfit, transforms, FPS, clear=False)])


def test_recorded_garments_are_played_as_they_are_and_refuse_a_motion_that_jumps() -> None:
    transforms, tube = motion(20), tube_garment("tops")
    turn = torch.linspace(0, 2, 20)
    transforms[:, 0, :2, :2] = torch.stack(
        [torch.stack([turn.cos(), -turn.sin()], 1), torch.stack([turn.sin(), turn.cos()], 1)], 1
    )
    moved = tube.mesh.vertices + 0.05 * torch.rand(20, len(tube.mesh.vertices), 3)
    outfit, recorded = Outfit(capsule_body(), (tube,)), Recorded.of("theirs", transforms, [moved])
    torch.testing.assert_close(rolled(recorded, outfit, transforms), moved, atol=1e-6, rtol=0)
    one = transforms[:10].clone()
    one[6:, :, 0, 3] += 5.0
    # A capsule of one joint looks the same everywhere: another pose needs another joint.
    other = Recorded("theirs", recorded.start + 0.1, recorded.garments)
    with pytest.raises(InputError, match="theirs: the motion jumps"):
        rolled(other, outfit, one)


def test_a_recording_of_a_method_is_finished_as_the_method_is(body: Body) -> None:
    outfit = Outfit(body, (fit_template("skirt", body),))
    transforms = torch.eye(3, 4).expand(6, len(body.skeleton.names), 3, 4).clone()
    transforms[..., 0, 3] = 0.03 * torch.arange(6)[:, None]
    skinned = create_lbs(LBSConfig(smooth=True))
    recorded = Recorded.of("theirs", transforms, [rolled(skinned, outfit, transforms)])
    fast = Physics(PhysicsConfig("fast"))
    one, other = (rolled(Finished.of(guide, fast), outfit, transforms) for guide in (skinned, recorded))
    assert float((one - other).norm(dim=2).mean()) < 1e-4
    assert float((one[-1] - rolled(skinned, outfit, transforms)[-1]).norm(dim=1).mean()) > 0.001
