"""Is it cloth? What engines and settings make of experiments whose outcome physics knows.

Run from the checkout with PYTHONPATH=. as

    python benchmarks/physics.py [--only explicit blender] [--skirt | --fabrics]

Prints one row for each setting, beside physics, with the CPU seconds that all of the row took, the processes
of other engines included. With --skirt it prints how the skirt of the dress swings after a stop, beside the
explicit engine with eight times the substeps and no self-contact; with --fabrics one row for each fabric, in
the settings that make data.
"""

import os
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import torch
import tyro

from tests.simulation.physics.experiments import (
    DISC,
    LIMP,
    STOP,
    Hem,
    bending_length,
    cantilever,
    drape,
    rope_period,
    rope_theory,
    sag,
    sag_theory,
    skirt_swing,
    slide,
    slide_theory,
    swing,
)
from tests.simulation.physics.scenes import FPS, play, scene, sheet
from uvcloth.physics.cloth.solver import Settings
from uvcloth.physics.fabric import FABRICS, Fabric
from uvcloth.process.command import run_command
from uvcloth.simulation.blender import find_blender
from uvcloth.simulation.explicit import Explicit

SETTINGS: dict[str, Callable[[], Any]] = {
    "explicit": Explicit,
    "explicit, twice the substeps": lambda: Explicit(more_substeps=2.0),
    "blender": find_blender,
}
"""The first makes data."""

SKIRT_SETTINGS: dict[str, Callable[[], Any]] = {
    "explicit, no self-contact": lambda: Explicit(settings=Settings(self_contact=False)),
    **SETTINGS,
}
"""The first tells how far the step is from converged, the others also how much cloth meets itself."""

COLUMNS = (
    "first low point, s, m",
    "second turning, s, m",
    "rope's period, s",
    "strip of 0.5 m longer, %",
    "slides at -2, mm",
    "slides at +2, mm",
    "drape, %",
    "bending length, mm",
    "CPU s",
)


RINGS = (5, 10, 15, 20)
"""Rings of the disc of Cusick's test: one of them lies on the edge of the support."""

SKIRT_COLUMNS = (
    "first period, s",
    "extremes of the hem, mm",
    "mean distance from the reference, mm",
    "CPU s",
)


def main(only: tuple[str, ...] = (), skirt: bool = False, fabrics: bool = False) -> None:
    """only: names of settings; all of them where none is named. skirt, fabrics: compare by these instead."""
    print("load of the machine:", *(f"{load:.2f}" for load in os.getloadavg()), end="\n\n")
    if fabrics:
        _print_fabrics()
    elif skirt:
        _print_skirts(only or tuple(SKIRT_SETTINGS))
    else:
        _print_experiments(only or tuple(SETTINGS))


def _print_experiments(names: tuple[str, ...]) -> None:
    """Print what physics says of each experiment, and below it what the settings make of it."""
    fabric = Fabric()
    print("| setting | " + " | ".join(COLUMNS) + " |")
    print("|---" * (len(COLUMNS) + 1) + "|")
    theory = (
        *("-", "-", f"{rope_theory():.3f}", f"{100 * sag_theory(fabric, 0.5):.2f}"),
        *(f"{1e3 * sum(slide_theory(fabric, beside)):.0f}" for beside in (-2.0, 2.0)),
        *("60-76", f"{1e3 * bending_length(fabric):.1f}", "-"),
    )
    print("| physics | " + " | ".join(theory) + " |", flush=True)
    for name in names:
        print(f"| {name} | " + " | ".join(_row(SETTINGS[name]())) + " |", flush=True)


def _print_skirts(names: tuple[str, ...]) -> None:
    """Print how a skirt swings after a stop, without air and with it, and how far that is from converged."""
    print("| setting | air | " + " | ".join(SKIRT_COLUMNS) + " |")
    print("|---|---" + "|---:" * len(SKIRT_COLUMNS) + "|")
    converged = Explicit(more_substeps=8.0, settings=Settings(self_contact=False))
    for air, fabric in (("no", Fabric(drag=0.0)), ("yes", Fabric())):
        reference, spent = _skirt(replace(converged, fabric=fabric))
        _print_skirt("reference", air, reference, reference, spent)
        for name in names:
            found, spent = _skirt(replace(SKIRT_SETTINGS[name](), fabric=fabric))
            _print_skirt(name, air, found, reference, spent)


def _skirt(engine: Any) -> tuple[Hem, float]:
    """Swing of the skirt, and the CPU seconds that it took."""
    _prepare(engine)
    started = _cpu_seconds()
    return skirt_swing(engine), _cpu_seconds() - started


def _print_skirt(name: str, air: str, found: Hem, reference: Hem, spent: float) -> None:
    apart = (found.motion - reference.motion)[round(STOP * FPS) :].norm(dim=-1).mean()
    figures = (
        f"{found.periods[0]:.3f}" if found.periods else "-",
        ", ".join(f"{1e3 * extreme:.0f}" for extreme in found.extremes[:3]),
        "-" if found is reference else f"{1e3 * float(apart):.1f}",
        f"{spent:.1f}",
    )
    print(f"| {name} | {air} | " + " | ".join(figures) + " |", flush=True)


def _prepare(engine: Any) -> None:
    """Have an engine compile what it needs, so that it does not count."""
    rest, faces = sheet(0.1, 0.1, 4, 4)
    play(engine, scene(rest, faces, 0.1, held=rest[:, 0] < 1e-6))


def _print_fabrics() -> None:
    """Print what laboratories measure of each fabric as the first setting makes it, and as physics has it."""
    drapes = (f"drape, edges of {1e3 * DISC / rings:g} mm, %" for rings in RINGS)
    print("| fabric | strip of 0.5 m longer, % | physics | " + " | ".join(drapes) + " |")
    print("|---|---:|---:" + "|---:" * len(RINGS) + "|")
    for name, fabric in FABRICS.items():
        engine = Explicit(fabric=fabric)
        stretched = f"{100 * sag(engine, 0.5):.2f} | {100 * sag_theory(fabric, 0.5):.2f}"
        draped = " | ".join(f"{100 * drape(engine, rings):.0f}" for rings in RINGS)
        print(f"| {name} | {stretched} | {draped} |", flush=True)


def _row(engine: Any) -> tuple[str, ...]:
    _prepare(engine)
    started = _cpu_seconds()
    found = swing(replace(engine, fabric=Fabric(drag=0.0)))
    figures = (
        *(f"{at:.3f}, {height:.3f}" for at, height in (found.low, found.high)),
        f"{rope_period(engine)[0]:.3f}",
        f"{100 * sag(replace(engine, fabric=replace(LIMP, poisson=0.0)), 0.5):.2f}",
        *(f"{1e3 * sum(slide(engine, beside)):.0f}" for beside in (-2.0, 2.0)),
        f"{100 * drape(engine):.0f}",
        f"{1e3 * cantilever(engine)[0]:.1f}",
    )
    return (*figures, f"{_cpu_seconds() - started:.1f}")


def _cpu_seconds() -> float:
    return sum(os.times()[:4])


if __name__ == "__main__":
    torch.set_grad_enabled(False)
    sys.exit(run_command("physics", lambda: tyro.cli(main)))
