"""`python -m rasterize SEQUENCE --out DIR`: EXR maps of a simulated sequence and one PNG contact sheet."""

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from tyro.conf import Positional, arg

from rasterize.archive import load_arrays, require_finite
from rasterize.command import run_command
from rasterize.errors import InputError

# The data that ships beside this package; its code is out of bounds down here.
SHIPPED = Path(__file__).parents[1] / "uvcloth" / "data"

Frames = Annotated[str, arg(metavar="FIRST:END:STEP")]


def rasterize(
    sequence: Positional[Path],
    *,
    out: Path,
    size: int = 256,
    frames: Frames = "::10",
    body: Path = SHIPPED / "body.npz",
    layout: Path = SHIPPED / "layout.npz",
) -> None:
    """Write body velocity, body acceleration, garment offset and masks of a simulated sequence.

    Args:
        sequence: A sequence npz made by `uvcloth simulate`.
        out: Folder for one EXR file per frame and contact_sheet.png.
        size: Texels along each side of the maps.
        frames: Which frames, as in Python's slices.
        body: The body npz that the sequence was simulated on.
        layout: The UV layout npz of that body.
    """
    import torch
    from rich.progress import track

    from rasterize.exr import write_png
    from rasterize.layout import load_layout
    from rasterize.moving import load_moving
    from rasterize.sheet import contact_sheet, frame_maps, see_garment, write_maps
    from rasterize.texels import rasterize_layout

    motion = load_moving(
        sequence,
        "uvcloth-sequence-3",
        "a sequence that this version's `uvcloth simulate` made",
        ("faces", "rest", "transforms", "fps"),
    )
    shape = load_arrays(
        body,
        "uvcloth-body-1",
        "a body made by `uvcloth body`",
        ("vertices", "faces", "weight_joints", "weights"),
    )
    require_finite(body, shape)
    sheet = load_layout(layout)
    rest, faces = torch.from_numpy(shape["vertices"]), torch.from_numpy(shape["faces"].astype(np.int64))
    transforms = torch.from_numpy(motion["transforms"])
    joints = torch.from_numpy(shape["weight_joints"].astype(np.int64))
    if int(joints.max()) >= transforms.shape[1] or int(sheet.faces.max()) >= len(faces):
        raise InputError(f"{body}: this body does not match {sequence} or {layout}")
    weights = torch.zeros(len(rest), transforms.shape[1])
    weights = weights.scatter_add_(1, joints, torch.from_numpy(shape["weights"]))
    weights = weights / weights.sum(1, keepdim=True)
    garment_faces = torch.from_numpy(motion["faces"].astype(np.int64))

    def pose(frame: int) -> torch.Tensor:
        blended = torch.einsum("vj,jrc->vrc", weights, transforms[max(frame, 0)])
        return (blended[..., :3] @ rest[..., None]).squeeze(-1) + blended[..., 3]

    if size < 1:
        raise InputError(f"--size {size}: expected at least one texel")
    texels = rasterize_layout(sheet, size)
    hits = see_garment(rest, faces, torch.from_numpy(motion["rest"]), garment_faces, texels)
    shown = {}
    for frame in track(_chosen(frames, len(transforms)), f"{sequence.name}: maps"):
        body_vertices = torch.stack([pose(frame - 2), pose(frame - 1), pose(frame)])
        cloth = torch.from_numpy(motion["vertices"][frame])
        maps = frame_maps(
            body_vertices, faces, cloth, garment_faces, hits=hits, texels=texels, fps=float(motion["fps"])
        )
        write_maps(maps, out / f"{sequence.stem}_{frame:04d}.exr")
        shown[frame] = maps
    write_png(out / "contact_sheet.png", contact_sheet(shown))
    print(f"{out}: {len(shown)} EXR files; contact_sheet.png has velocity, acceleration, offset per frame")


def _chosen(frames: str, count: int) -> list[int]:
    """The frames that a slice such as 0:60:10 names."""
    try:
        chosen = list(range(count))[slice(*(int(part) if part else None for part in frames.split(":")))]
    except (ValueError, TypeError) as error:
        raise InputError(f"--frames {frames}: expected FIRST:END:STEP, such as 0:60:10") from error
    if not chosen:
        raise InputError(f"--frames {frames}: names none of the {count} frames")
    return chosen


if __name__ == "__main__":
    sys.exit(run_command("rasterize", lambda: tyro.cli(rasterize)))
