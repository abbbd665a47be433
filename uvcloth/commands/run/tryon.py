"""Pictures of the person of a photograph in other clothes."""

from collections import deque
from collections.abc import Iterator
from functools import partial

from rich.console import Console

from uvcloth.bodies.body import load_body
from uvcloth.commands.run.worn import load_wanted_method, load_worn
from uvcloth.commands.tryon import TryOn
from uvcloth.files.image import read_picture, write_png
from uvcloth.rollouts.ready import ready_rollout
from uvcloth.tryon.fit import fit_person, require_fit
from uvcloth.tryon.keypoints import read_keypoints
from uvcloth.tryon.picture import dressed_picture, fitted_picture


def run(command: TryOn) -> None:
    """Write the pictures and say how well the body fits. Raises InputError for bad input."""
    for line in try_on(command):
        print(line)


def try_on(command: TryOn) -> Iterator[str]:
    """Dress the person of a photograph, and yield a line on the fit and on each picture that is written.

    The garments move from the rest pose into that of the person. Raises InputError for bad input, and if no
    pose fits; the picture of the fitted body is written all the same.
    """
    console, body = Console(stderr=True), load_body(command.body)
    report = partial(console.print, highlight=False, markup=False, soft_wrap=True)
    photograph = read_picture(command.photo)
    size = photograph.shape[1], photograph.shape[0]
    keypoints = read_keypoints(command.keypoints, size)
    with console.status("loading the garments"):
        outfit = load_worn(command.garment, command.fitting, body, report)
        method, clear, line = load_wanted_method(command, outfit)
    if line:
        report(line)
    with console.status("fitting the body"):
        person = fit_person(keypoints, body, size, command.view)
    others = f", the largest of {keypoints.people} persons" if keypoints.people > 1 else ""
    yield (
        f"{command.keypoints}: {len(keypoints.names)} keypoints{others}, missed by {person.error:.1f} pixels "
        f"on average, {person.relative:.1%} of the torso"
    )
    if command.fitted is not None:
        write_png(command.fitted, fitted_picture(photograph, person, body, keypoints))
        yield f"{command.fitted}: the fitted body; keypoints red, those of the body green"
    require_fit(person, command.keypoints)
    with console.status("moving the garments into the pose"):
        ready = ready_rollout(method, outfit, person.clip, clear)
        (last,) = deque(ready.frames(), maxlen=1)
    with console.status("drawing"):
        picture = dressed_picture(photograph, person, body, ready.proxied.meshes, last.in_world())
        write_png(command.out, picture)
    yield f"{command.out}: {size[0]} x {size[1]} pixels"
