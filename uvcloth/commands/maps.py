"""`uvcloth maps`: from a simulated sequence to EXR maps and one PNG contact sheet."""

from pathlib import Path

from rich.progress import track

from rasterize.exr import write_exr
from rasterize.sheet import contact_sheet, frame_maps, see_garment
from rasterize.texels import rasterize_layout
from uvcloth.bodies.body import load_body
from uvcloth.bodies.layout import layout_of
from uvcloth.bodies.posing import posed_skin
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.errors import InputError
from uvcloth.files.image import atomic_image, write_png
from uvcloth.formats.layout_file import load_layout


def draw_maps(
    path: Path,
    out: Path,
    *,
    size: int = 256,
    frames: str = "::10",
    body_file: Path | None = None,
    layout_file: Path | None = None,
) -> int:
    """Write one EXR file per chosen frame of a sequence, and contact_sheet.png; returns how many frames.

    size: texels along each side. frames: a slice such as 0:60:10. Raises InputError for bad input, and for
    another body or layout than the sequence's.
    """
    if size < 1:
        raise InputError(f"--size {size}: expected at least one texel")
    clip = load_simulated(path)
    (garment,) = clip.garments
    body = load_body(body_file)
    if len(body.skeleton.names) != clip.transforms.shape[1]:
        raise InputError(f"{path}: was not simulated on the body {body.name}, whose skeleton is another")
    layout = load_layout(layout_file) if layout_file else layout_of(body)
    rest, faces = body.mesh.vertices, body.mesh.faces
    if int(layout.faces.max()) >= len(faces):
        raise InputError(f"{layout_file}: this layout is not of the body {body.name}")
    chosen = _chosen(frames, len(garment.vertices))
    texels = rasterize_layout(layout, size)
    hits = see_garment(rest, faces, garment.rest, garment.faces, texels)
    shown = {}
    for frame in track(chosen, f"{path.name}: maps"):
        history = [max(frame - back, 0) for back in (2, 1, 0)]
        maps = frame_maps(
            posed_skin(body, clip.transforms[history]),
            faces,
            garment.vertices[frame],
            garment.faces,
            hits=hits,
            texels=texels,
            fps=clip.fps,
        )
        with atomic_image(out / f"{path.stem}_{frame:04d}.exr") as partial:
            write_exr(partial, maps.channels())
        shown[frame] = maps
    write_png(out / "contact_sheet.png", contact_sheet(shown))
    return len(shown)


def _chosen(frames: str, count: int) -> list[int]:
    """The frames that a slice such as 0:60:10 names."""
    try:
        chosen = list(range(count))[slice(*(int(part) if part else None for part in frames.split(":")))]
    except (ValueError, TypeError) as error:
        raise InputError(f"--frames {frames}: expected FIRST:END:STEP, such as 0:60:10") from error
    if not chosen:
        raise InputError(f"--frames {frames}: names none of the {count} frames")
    return chosen
