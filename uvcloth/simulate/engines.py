"""The cloth engines by name, with the settings that an outfit gets."""

from collections.abc import Callable

from uvcloth.simulate.blender import find_blender
from uvcloth.simulate.engine import Engine
from uvcloth.simulate.newton import Style3D

PLAIN = Style3D()
# Stiff contact presses hard for an instant, and with friction walks a skirt up the thighs.
SKIRTED = Style3D(contact_stiffness=1e3, friction=0.15)


def _newton(skirted: bool) -> Engine:
    return SKIRTED if skirted else PLAIN


def _blender(skirted: bool) -> Engine:
    return find_blender()


ENGINES: dict[str, Callable[[bool], Engine]] = {"newton": _newton, "blender": _blender}
"""Each is told whether a skirt is among the cloths, and raises InputError if the engine is not installed."""
