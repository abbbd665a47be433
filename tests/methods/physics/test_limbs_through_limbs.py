"""A forearm that mocap moves through a knee: its sleeve does not take the trousers off the leg."""

from pathlib import Path

import uvcloth
from uvcloth.bodies.body import Body
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.physics.exposure import Exposure
from uvcloth.rollouts.ready import ready_method, ready_rollout


def test_trousers_stay_on_a_knee_that_a_sleeve_goes_through(mocap_folder: Path, body: Body) -> None:
    """Somebody picks something up: CMU 02_06. With contact there 1.7 % of the covered skin are seen."""
    clip = uvcloth.load_motion(mocap_folder / "cmu" / "02_06.bvh", body, frames="104:120")
    outfit = Outfit(body, tuple(load_garment(name, body) for name in ("bottoms", "shirt")))
    method, clear = ready_method(["physics"], outfit, None, "fast", ())
    exposure = Exposure(body, [garment.mesh for garment in outfit.garments])
    frames = ready_rollout(method, outfit, clip, clear).frames()
    assert max(exposure.percent(frame.vertices, frame.body_vertices) for frame in frames) < 0.6
