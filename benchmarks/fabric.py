"""Five fabrics of PBNS, from soft to stiff, as in the paper's Figure 5: do edges and folds follow?

Run from the checkout with PYTHONPATH=. as

    python benchmarks/fabric.py --poses poses.npz --out fabrics [--garment tops] [--steps 1500]

Each fabric is trained alike in OUT/STRETCH_BEND, which an interrupted run resumes. Prints the measures on the
validation poses and draws one of them in every fabric: OUT/fabrics.png.
"""

import os
import subprocess
import sys
from pathlib import Path

import torch
import tyro
from PIL import Image

from train.loop import has_begun
from train.pbns.poses import poses_for
from uvcloth.bodies.body import load_body
from uvcloth.bodies.frames import body_frames, with_lead
from uvcloth.checkpoint import load_checkpoint
from uvcloth.garments.garment import Outfit
from uvcloth.garments.loading import load_garment
from uvcloth.methods.registry import load_method
from uvcloth.process.command import run_command
from uvcloth.rendering.render import BODY_COLOR, GARMENT_COLORS, Surface, contact_sheet, render, three_quarter

FABRICS = ((11.6, 1.7e-6), (23.1, 8.7e-6), (34.6, 1.7e-5), (46.2, 8.7e-5), (57.7, 1.7e-4))
"""Stretch, N/m, and bend, N m: the paper's weights of 5 to 25 N/m and 1e-6 to 1e-4 J."""

SIZE = (360, 480)
"""Width and height of a picture, pixels."""


def main(poses: Path, out: Path, garment: str = "tops", steps: int = 1500, pose: int = 0) -> None:
    """Train what is missing, then compare. pose: number of the validation pose that is drawn."""
    body = load_body()
    chosen = poses_for([str(poses)], body, out).database.of("validation").transforms(body.skeleton)[pose]
    frames = body_frames(body, with_lead(chosen[None]), 30.0)
    outfit = Outfit(body, (load_garment(garment, body),))
    skin = frames.vertices[0, -1]
    pictures = []
    print("| stretch, N/m | bend, N m | edge change, mm | bend, rad | bend, 1 - cos | inside, % |")
    print("|---:|---:|---:|---:|---:|---:|")
    for stretch, bend in FABRICS:
        run = out / f"{stretch:g}_{bend:g}"
        _train(run, poses, garment, steps, stretch, bend)
        found = load_checkpoint(run).notes["validation"]
        keys = ("edge_mm", "bend_rad", "bend_cos", "inside_percent")
        print(
            f"| {stretch:g} | {bend:g} | " + " | ".join(f"{found[key]:.3f}" for key in keys) + " |",
            flush=True,
        )
        method = load_method(run, body)
        prepared = method.prepare(outfit, torch.device("cpu"))
        _, (vertices,) = method.step(prepared, method.init(prepared, frames), frames)
        faces = outfit.garments[0].mesh.faces
        surfaces = [
            Surface(skin, body.mesh.faces, BODY_COLOR),
            Surface(vertices[0], faces, GARMENT_COLORS[0]),
        ]
        camera = three_quarter(skin, aspect=SIZE[0] / SIZE[1])
        pictures.append(render(surfaces, camera, SIZE, float(skin[:, 2].min())))
    Image.fromarray(contact_sheet(pictures, columns=len(pictures))).save(out / "fabrics.png")


def _train(run: Path, poses: Path, garment: str, steps: int, stretch: float, bend: float) -> None:
    finished = run / "finished"
    if finished.exists():
        return
    command = [sys.executable, "-m", "train", "pbns", "--garment", garment, "--poses", str(poses)]
    command += ["--out", str(run), "--steps", str(steps), "--validate-every", str(steps)]
    command += ["--stretch", str(stretch), "--bend", str(bend), *(["--resume"] if has_begun(run) else [])]
    subprocess.run(command, check=True, env={**os.environ, "PYTHONPATH": "."})
    finished.touch()


if __name__ == "__main__":
    torch.set_grad_enabled(False)
    sys.exit(run_command("fabric", lambda: tyro.cli(main)))
