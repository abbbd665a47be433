"""Height of a body, and its ratio to that of adults, for whom limits and models are made."""

from uvcloth.bodies.body import Body
from uvcloth.geometry.once import once_per_record

ADULTS = (1.4, 2.2)
"""Heights of adults, metres; the models that ship and limits of speed are for their motion and clothes."""


@once_per_record
def stature(body: Body) -> float:
    """Height of a body at rest, metres."""
    heights = body.mesh.vertices[:, 2]
    return float(heights.max() - heights.min())


def beside_adults(body: Body) -> float:
    """Height of a body over that of the nearest adult: 1 for adults, 0.5 for a person of 0.7 m."""
    tall = stature(body)
    return tall / min(max(tall, ADULTS[0]), ADULTS[1])
