"""The cloth engines by name, with the settings that an outfit gets."""

from collections.abc import Callable, Sequence

from uvcloth.simulate.blender import find_blender
from uvcloth.simulate.cloth import Cloth
from uvcloth.simulate.engine import Engine
from uvcloth.simulate.newton import Style3D

PLAIN = Style3D()
# Stiff contact presses hard for an instant, and with friction walks a skirt up the thighs.
SKIRTED = Style3D(contact_stiffness=1e3, friction=0.15)


def _newton(cloths: Sequence[Cloth]) -> Engine:
    return SKIRTED if any(cloth.garment.template == "dress" for cloth in cloths) else PLAIN


def _blender(cloths: Sequence[Cloth]) -> Engine:
    return find_blender()


ENGINES: dict[str, Callable[[Sequence[Cloth]], Engine]] = {"newton": _newton, "blender": _blender}
"""Each raises InputError if the engine is not installed."""
