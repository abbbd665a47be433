"""Cost of many characters in one baked outfit: one after another, and in threads.

Run from the checkout with PYTHONPATH=. as

    python benchmarks/runtime_characters.py [--garment dress] [--characters 16] [--threads 1 2]

Each walks from a frame of its own. It prints the milliseconds that a frame takes per character, by the clock
and of processor time, the best of some rounds, and their ratios to those of one character alone.
"""

import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
import tyro
from numpy.typing import NDArray

from uvcloth.bodies.body import load_body
from uvcloth.garments.garment import Outfit as WornOutfit
from uvcloth.garments.loading import load_garment
from uvcloth.methods.physics.outfit import PhysicsConfig, bake_outfit
from uvcloth.motion.library import load_clip
from uvcloth.player.outfit import Cloth, Outfit
from uvcloth.process.command import run_command

ROUNDS, FRAMES = 5, 10
"""Rounds of frames that are timed."""


@dataclass(frozen=True)
class Characters:
    """Measure characters that share an outfit."""

    garment: str = "dress"
    """Template."""
    quality: str = "default"
    """Quality of the cages."""
    characters: int = 16
    """Number of characters."""
    threads: tuple[int, ...] = (1, 2)
    """Numbers of threads."""

    def run(self) -> None:
        """Print the table."""
        body = load_body()
        worn = WornOutfit(body, (load_garment(self.garment, body),))
        outfit = Outfit(bake_outfit(worn, PhysicsConfig(self.quality)))
        clip = load_clip("walk", body)
        motion = clip.transforms(torch.float64).numpy()
        alone = _milliseconds(outfit, motion, clip.fps, 1, 1)
        print(f"1 character: {alone[0]:.2f} ms a frame, {alone[1]:.2f} ms of processor time")
        for threads in self.threads:
            each = _milliseconds(outfit, motion, clip.fps, self.characters, threads)
            ratios = ", ".join(f"{some / one:.2f}" for some, one in zip(each, alone, strict=True))
            print(
                f"{self.characters} characters, {threads} threads: {each[0]:.2f} ms a frame and character, "
                f"{each[1]:.2f} ms of processor time; of one alone {ratios}"
            )


def _milliseconds(
    outfit: Outfit, motion: NDArray[np.float64], fps: float, characters: int, threads: int
) -> tuple[float, float]:
    """Time of a frame per character, ms, by the clock and of the processor, in the best rounds."""
    clothes = [Cloth(outfit) for _ in range(characters)]
    for number, cloth in enumerate(clothes):
        cloth.start(motion[number])

    def play(number: int, first: int) -> None:
        for frame in range(first, first + FRAMES):
            clothes[number].step(motion[number + frame], 1.0 / fps)

    best = np.full(2, np.inf)
    with ThreadPoolExecutor(threads) as pool:
        for turn in range(ROUNDS):
            begun = np.array([time.perf_counter(), time.process_time()])
            list(pool.map(play, range(characters), [FRAMES * turn] * characters))
            best = np.minimum(best, np.array([time.perf_counter(), time.process_time()]) - begun)
    clock, processor = (1e3 * best / FRAMES / characters).tolist()
    return clock, processor


if __name__ == "__main__":
    sys.exit(run_command("runtime_characters.py", lambda: tyro.cli(Characters).run()))
