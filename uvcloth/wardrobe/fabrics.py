"""Fabrics that outfits are made of: the numbers that `uvcloth.simulate.fabric.Fabric` takes, by name."""

from collections.abc import Mapping

FABRICS: Mapping[str, Mapping[str, float]] = {
    "jersey": {"density": 0.2, "stretch": 40.0, "poisson": 0.2, "bend": 1.5e-5, "friction": 0.4, "drag": 1.2},
    "cotton": {
        "density": 0.15,
        "stretch": 60.0,
        "poisson": 0.2,
        "bend": 2.0e-5,
        "friction": 0.4,
        "drag": 1.2,
    },
    "silk": {"density": 0.08, "stretch": 50.0, "poisson": 0.2, "bend": 5.0e-6, "friction": 0.25, "drag": 1.2},
    "denim": {"density": 0.35, "stretch": 80.0, "poisson": 0.2, "bend": 8.0e-5, "friction": 0.5, "drag": 1.2},
}
"""Density kg/m2, stretch N/m, Poisson ratio, bend N m, friction, drag."""

VARIED = {"density": 0.15, "stretch": 0.2, "bend": 0.4}
"""Share by which a drawn fabric's numbers differ from those of its name, at most."""
