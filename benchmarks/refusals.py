"""Meshes that must be refused, and garments that must not: what `uvcloth fit` says of each.

Run from the checkout with PYTHONPATH=. as

    OMP_NUM_THREADS=1 python benchmarks/refusals.py [--only chair tops]

The meshes are made up (`tests/acceptance/misfits.py`). Each is printed with its processor time
and a sentence. The command fails if one is worn that nobody wears, refused for another reason, or refused
though it is worn.
"""

import re
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import torch
import tyro

from tests.acceptance.misfits import REFUSED, WORN
from uvcloth.bodies.body import load_body
from uvcloth.errors import InputError
from uvcloth.garments.fit import place_on_body
from uvcloth.process.command import run_command


@dataclass(frozen=True)
class Refusals:
    """Place made-up meshes on the body that ships, and compare what is refused."""

    only: tuple[str, ...] = ()
    """Names of meshes; all by default."""

    def run(self) -> None:
        """Print a line for each. Raises InputError for those that are judged wrongly."""
        torch.set_num_threads(1)
        torch.set_grad_enabled(False)
        body, wrong = load_body(), []
        expected = {name: sentence for name, (_, sentence) in REFUSED.items()} | dict.fromkeys(
            WORN, "^worn: "
        )
        makers = {name: make for name, (make, _) in REFUSED.items()} | dict(WORN)
        for name in self.only or makers:
            mesh, begun = makers[name](body), time.process_time()
            try:
                said = f"worn: {', '.join(place_on_body(Path(name), mesh, body).diagnosis.way)}"
            except InputError as error:
                said = str(error).removeprefix(f"{name}: ")
            right = re.search(expected[name], said) is not None
            wrong += [] if right else [name]
            print(
                f"{'' if right else 'WRONG '}{name}, {time.process_time() - begun:.1f} s: {said}", flush=True
            )
        if wrong:
            raise InputError(f"judged wrongly: {', '.join(wrong)}")


if __name__ == "__main__":
    sys.exit(run_command("refusals.py", lambda: tyro.cli(Refusals).run()))
