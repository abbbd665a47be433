"""UV maps of a simulated sequence, as EXR files and one PNG contact sheet."""

from rich.progress import track

from rasterize.exr import write_exr
from rasterize.sheet import contact_sheet, frame_maps, see_garment
from rasterize.texels import rasterize_layout
from uvcloth.bodies.body import load_body
from uvcloth.bodies.layout import layout_of
from uvcloth.bodies.posing import posed_skin
from uvcloth.commands.maps import Maps
from uvcloth.dataset.clip_file import load_simulated
from uvcloth.errors import InputError
from uvcloth.files.image import atomic_image, write_png


def run(command: Maps) -> None:
    """Write the maps. Raises InputError for bad input."""
    count = draw_maps(command)
    print(f"{command.out}: {count} EXR files; contact_sheet.png has velocity, acceleration, offset per frame")


def draw_maps(command: Maps) -> int:
    """Write one EXR file per frame of a sequence, and contact_sheet.png; returns the number of frames.

    Raises InputError for bad input, and for another body than the sequence's.
    """
    path, out, size = command.sequence, command.out, command.size
    clip = load_simulated(path)
    (garment,) = clip.garments
    body = load_body(command.body)
    if len(body.skeleton.names) != clip.transforms.shape[1]:
        raise InputError(f"{path}: was not simulated on the body {body.name}, their skeletons differ")
    layout = layout_of(body)
    rest, faces = body.mesh.vertices, body.mesh.faces
    frames = _frames(command.frames, len(garment.vertices))
    texels = rasterize_layout(layout, size)
    hits = see_garment(rest, faces, garment.rest, garment.faces, texels)
    shown = {}
    for frame in track(frames, f"{path.name}: maps"):
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


def _frames(span: str, count: int) -> list[int]:
    """Frames that a slice such as 0:60:10 names."""
    try:
        frames = list(range(count))[slice(*(int(part) if part else None for part in span.split(":")))]
    except (ValueError, TypeError) as error:
        raise InputError(f"--frames {span}: expected FIRST:END:STEP, such as 0:60:10") from error
    if not frames:
        raise InputError(f"--frames {span}: selects none of the {count} frames")
    return frames
