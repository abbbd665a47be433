"""Random outfits: designs, mesh, fabric and tightness, drawn from a seed and the outfit's number."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from uvcloth.physics.fabric import FABRICS, Fabric
from uvcloth.wardrobe.designs import KINDS, PARTS, Design, limits
from uvcloth.wardrobe.sew import Meshing

Alternatives = Sequence[tuple[float, float]]

NONE: Alternatives = ((0.0, 0.0),)
SHORT, LONG = (0.3, 0.85), (1.35, 1.85)
"""Lengths of short and of long sleeves: no cuff lies in the crook of the arm or on the hand."""

Intervals = Mapping[str, Alternatives]

SHIRT: Intervals = {
    "hem": ((-0.02, 0.22),),
    "neck_depth": ((0.0, 0.0), (0.01, 0.09)),
    "flare": ((0.0, 0.0), (0.0, 0.03)),
    "front_gap": NONE,
}

BODICE: Intervals = {
    **SHIRT,
    "sleeve": ((0.0, 0.0), SHORT, LONG),
    "neck_depth": ((0.0, 0.0), (0.02, 0.12)),
    "flare": NONE,
}

SLIT: Alternatives = ((0.0, 0.0), (0.0, 0.0), (0.06, 0.15))

DRAWN: Mapping[str, Mapping[str, Intervals]] = {
    "tshirt": {"upper": {**SHIRT, "sleeve": (SHORT,)}},
    "top": {"upper": {**SHIRT, "sleeve": NONE, "neck_depth": ((0.03, 0.13),), "hem": ((-0.02, 0.3),)}},
    "longsleeve": {"upper": {**SHIRT, "sleeve": (LONG,)}},
    "jacket": {
        "upper": {
            **SHIRT,
            "sleeve": (LONG,),
            "neck_depth": ((0.02, 0.1),),
            "neck_power": ((1.0, 1.3),),
            "ease": ((0.014, 0.045),),
            "front_gap": ((0.015, 0.08),),
        }
    },
    "trousers": {"legs": {"length": ((1.3, 2.0),), "flare": ((0.0, 0.01), (0.0, 0.05))}},
    "shorts": {"legs": {"length": ((0.35, 1.05),), "flare": ((0.0, 0.01), (0.0, 0.03))}},
    "skirt": {
        "skirt": {
            "drop": ((0.0, 0.09),),
            "length": ((0.35, 1.0), (0.9, 1.85)),
            "flare": ((-0.05, 0.15), (0.15, 0.45)),
            "slit": SLIT,
        }
    },
    "gown": {
        "upper": BODICE,
        "skirt": {
            "drop": ((-0.06, 0.04),),
            "length": ((0.4, 1.0), (0.9, 1.85)),
            "flare": ((-0.03, 0.15), (0.15, 0.4)),
            "slit": SLIT,
        },
    },
    "jumpsuit": {
        "upper": BODICE,
        "legs": {"length": ((0.4, 1.0), (1.3, 2.0)), "flare": ((0.0, 0.01), (0.0, 0.04))},
    },
}
"""By type of piece and part, where a number is drawn: in one of some intervals, others in all their range."""

OVER: Intervals = {"hem": ((-0.02, 0.12), (-0.02, 0.12), (0.3, 0.36))}
OVER_SKIRT: Intervals = {"hem": ((0.06, 0.13), (0.06, 0.13), (0.3, 0.36)), "flare": NONE}
"""Other intervals for a top over others: it covers their waist or leaves it bare, and does not reach
far down on a skirt that flares."""

UNDER_TOP: Intervals = {"drop": ((0.0, 0.04),)}
"""Other intervals for a piece under a top."""

UPPERS, LOWERS = ("tshirt", "top", "longsleeve", "jacket"), ("trousers", "shorts", "skirt")
OUTFITS = (*KINDS, *(f"{upper}+{lower}" for upper in UPPERS for lower in LOWERS))
"""Types of outfits: one piece, or an upper one over a lower one."""

ONE_PIECE = 0.5
"""Share of the outfits of one piece, where all types are drawn."""

EVEN, SEAMS = 0.7, 0.25
"""Shares of outfits with even triangles, and with doubled vertices along their seams."""

VARIED = {"density": 0.15, "stretch": 0.2, "bend": 0.4}
"""Share by which a drawn fabric's numbers differ from those of its name, at most."""

LOOSENESS_SPREAD = 0.12
"""Standard deviation by which pieces differ in looseness from their outfit's."""


@dataclass(frozen=True)
class DrawnOutfit:
    """Outfit as it was drawn.

    designs: the innermost first. tightness: 0 loose to 1 tight.
    """

    designs: tuple[Design, ...]
    meshing: Meshing
    fabric_name: str
    fabric: Fabric
    tightness: float


def draw(rng: np.random.Generator, types: Sequence[str], vertices: tuple[int, int]) -> DrawnOutfit:
    """Draw an outfit of one of some types (of OUTFITS), with a number of vertices between two."""
    one = [name for name in types if "+" not in name]
    two = [name for name in types if "+" in name]
    pieces = one if not two or (one and rng.random() < ONE_PIECE) else two
    kinds = pieces[rng.integers(len(pieces))].split("+")[::-1]
    tightness = float(rng.random())
    designs = []
    for kind in kinds:
        otherwise: Intervals = {}
        if len(kinds) == 2:
            over_skirt = OVER_SKIRT if kinds[0] == "skirt" else OVER
            otherwise = UNDER_TOP if kind in LOWERS else over_skirt
        designs.append(_design(rng, kind, tightness, otherwise))
    name = str(rng.choice(list(FABRICS)))
    return DrawnOutfit(
        designs=tuple(designs),
        meshing=Meshing(
            vertices=int(rng.integers(vertices[0], vertices[1], endpoint=True)),
            even=bool(rng.random() < EVEN),
            seams=bool(rng.random() < SEAMS),
        ),
        fabric_name=name,
        fabric=Fabric(
            **{
                key: _rounded(value * (1 + VARIED.get(key, 0.0) * rng.uniform(-1, 1)))
                for key, value in asdict(FABRICS[name]).items()
            }
        ),
        tightness=_rounded(tightness),
    )


def _design(rng: np.random.Generator, kind: str, tightness: float, otherwise: Intervals) -> Design:
    parameters: dict[str, dict[str, float]] = {}
    for part in KINDS[kind]:
        drawn = {**DRAWN[kind][part], **otherwise}
        values: dict[str, Any] = {}
        for name, whole in limits(PARTS[part]).items():
            intervals = drawn.get(name, (whole,))
            low, high = intervals[int(rng.integers(len(intervals)))]
            low, high = max(low, whole[0]), min(high, whole[1])
            share = rng.random()
            if name.endswith("ease"):
                share = np.clip(1 - tightness + LOOSENESS_SPREAD * rng.standard_normal(), 0, 1)
            values[name] = _rounded(low + share * (high - low))
        parameters[part] = values
    return Design.of(kind, parameters)


def _rounded(value: float) -> float:
    """A number with four significant digits: the file holds the exact number that was sewn."""
    return float(f"{value:.4g}")
