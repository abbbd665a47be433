"""The outfit that files show: as it is rolled out, or with wrinkles on finer meshes."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from time import perf_counter

from uvcloth.commands.rollout import Rollout
from uvcloth.errors import InputError
from uvcloth.garments.proxy import ProxiedOutfit
from uvcloth.geometry.mesh import Mesh
from uvcloth.methods.method import Method
from uvcloth.methods.physics.method import Physics
from uvcloth.rollouts.rollout import JUMPED, RolloutFrame
from uvcloth.wrinkles.model import BY_DEFAULT, TRAINED_BODY, load_wrinkles, shipped_for
from uvcloth.wrinkles.outfit import WrinkledOutfit
from uvcloth.writers.pictures import SHEETS, VIDEOS


@dataclass(frozen=True)
class VisibleOutfit:
    """Garments as files show them. wrinkled: None for plain ones."""

    proxied: ProxiedOutfit
    wrinkled: WrinkledOutfit | None = None

    @property
    def meshes(self) -> tuple[Mesh, ...]:
        """Meshes at rest."""
        return self.wrinkled.meshes if self.wrinkled else self.proxied.meshes

    @property
    def lines(self) -> tuple[str, ...]:
        """A sentence on the wrinkles of each garment."""
        return self.wrinkled.lines if self.wrinkled else ()

    def named(self) -> list[tuple[str, Mesh]]:
        """Name and mesh of each garment."""
        return [(name, mesh) for (name, _), mesh in zip(self.proxied.named(), self.meshes, strict=True)]

    def frames(self, frames: Iterable[RolloutFrame], fps: float) -> Iterator[RolloutFrame]:
        """Yield the frames of a rollout as they are shown; with wrinkles, they are in the world.

        fps: of these frames.
        """
        for frame in frames:
            if self.wrinkled is None:
                yield frame
                continue
            begun = perf_counter()
            if JUMPED in frame.difficulties:
                self.wrinkled.begin()
            placed = frame.in_world()
            vertices = self.wrinkled.shown(placed.vertices, placed.body_vertices, fps)
            spent = {**placed.milliseconds, "wrinkles": 1000.0 * (perf_counter() - begun)}
            yield replace(placed, raw=vertices, vertices=vertices, milliseconds=spent)


def visible_outfit(command: Rollout, method: Method, proxied: ProxiedOutfit) -> VisibleOutfit:
    """The outfit as the files of a command show it.

    Videos and pictures of templates of BY_DEFAULT on the default body have wrinkles, unless --plain.
    Raises InputError for wrinkles that were asked for if their network cannot be read, or if no cage of the
    cloth solver moves the garments.
    """
    if not isinstance(method, Physics):
        if command.wrinkles:
            raise InputError(f"--wrinkles: lie on what the cloth solver moves, not on {method.name}")
        return VisibleOutfit(proxied)
    folder = command.wrinkles_from or shipped_for(proxied.outfit)
    usual = proxied.outfit.body.name == TRAINED_BODY and folder.name in BY_DEFAULT
    if not (command.wrinkles or (usual and _only_pictures(command))):
        return VisibleOutfit(proxied)
    wrinkles = load_wrinkles(folder)
    wrinkled = WrinkledOutfit(wrinkles, proxied.outfit, proxied.meshes, command.quality)
    return VisibleOutfit(proxied, wrinkled if command.wrinkles or wrinkled.serves else None)


def _only_pictures(command: Rollout) -> bool:
    """True if all that a command writes is finished videos and pictures, of cloth that may have wrinkles."""
    other = command.plain or command.view or command.preview or command.loop
    return not other and all(path.suffix.lower() in (*VIDEOS, *SHEETS) for path in command.out)
