"""Is it cloth? What engines and settings make of experiments whose outcome physics knows.

Run from the checkout with PYTHONPATH=. as

    python benchmarks/physics.py [--only "vbd 20 x 2" blender] [--fabrics]

Prints one row for each setting, beside physics, with the CPU seconds that all of the row took, the processes
of other engines included; with --fabrics instead one row for each fabric, in the settings that make data.
"""

import os
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import torch
import tyro

from rasterize.command import run_command
from tests.simulate.physics.experiments import (
    LIMP,
    bending_length,
    cantilever,
    drape,
    rope_period,
    rope_theory,
    sag,
    sag_theory,
    slide,
    slide_theory,
    swing,
)
from uvcloth.physics.fabric import FABRICS, Fabric
from uvcloth.simulate.blender import find_blender
from uvcloth.simulate.newton import Newton

SETTINGS: dict[str, Callable[[], Any]] = {
    "vbd 20 x 3": Newton,
    "vbd 20 x 2": lambda: Newton(iterations=2),
    "vbd 10 x 3": lambda: Newton(substeps=10),
    "vbd 10 x 5": lambda: Newton(substeps=10, iterations=5),
    "vbd 60 x 30": lambda: Newton(substeps=60, iterations=30),
    "blender": find_blender,
}
"""The first is what makes data, the fifth is converged in what swings."""

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


def main(only: tuple[str, ...] = (), fabrics: bool = False) -> None:
    """only: names of settings; all of them where none is named. fabrics: compare these instead."""
    if fabrics:
        _print_fabrics()
        return
    fabric = Fabric()
    print("| setting | " + " | ".join(COLUMNS) + " |")
    print("|---" * (len(COLUMNS) + 1) + "|")
    theory = (
        *("-", "-", f"{rope_theory():.3f}", f"{100 * sag_theory(fabric, 0.5):.2f}"),
        *(f"{1e3 * sum(slide_theory(fabric, beside)):.0f}" for beside in (-2.0, 2.0)),
        *("60-76", f"{1e3 * bending_length(fabric):.1f}", "-"),
    )
    print("| physics | " + " | ".join(theory) + " |", flush=True)
    for name in only or SETTINGS:
        print(f"| {name} | " + " | ".join(_row(SETTINGS[name]())) + " |", flush=True)


def _print_fabrics() -> None:
    """Print what laboratories measure of each fabric as the first setting makes it, and as physics has it."""
    print("| fabric | strip of 0.5 m longer, % | physics | drape, % |")
    print("|---|---:|---:|---:|")
    for name, fabric in FABRICS.items():
        engine = Newton(fabric=fabric)
        print(
            f"| {name} | {100 * sag(engine, 0.5):.2f} | {100 * sag_theory(fabric, 0.5):.2f} "
            f"| {100 * drape(engine):.0f} |",
            flush=True,
        )


def _row(engine: Any) -> tuple[str, ...]:
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
    return (*figures, f"{_cpu_seconds() - started:.0f}")


def _cpu_seconds() -> float:
    return sum(os.times()[:4])


if __name__ == "__main__":
    torch.set_grad_enabled(False)
    sys.exit(run_command("physics", lambda: tyro.cli(main)))
