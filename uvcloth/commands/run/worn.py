"""The garments and the method that the options of a command ask for."""

from collections.abc import Callable, Sequence

from uvcloth.bodies.body import Body
from uvcloth.commands.options import FitOptions
from uvcloth.commands.rollout import Rollout
from uvcloth.commands.tryon import TryOn
from uvcloth.garments.fit import Fitting
from uvcloth.garments.garment import Outfit
from uvcloth.garments.holds import Hold
from uvcloth.garments.loading import load_outfit
from uvcloth.garments.on_character import CharacterFrame
from uvcloth.garments.tucks import Tuck
from uvcloth.methods.automatic import AUTO, named_models
from uvcloth.methods.finish_names import FinishName
from uvcloth.methods.method import Method
from uvcloth.rollouts.ready import ready_method


def load_worn(
    garments: Sequence[str],
    fitting: FitOptions,
    body: Body,
    report: Callable[[str], None],
    templates: Sequence[str] = (),
    frame: CharacterFrame | None = None,
) -> Outfit:
    """The garments of a command on a body. templates: as `load_outfit` has them. frame: as in Fitting."""
    how = Fitting(fitting.garment_pose, from_body=fitting.from_body, frame=frame)
    tucks = [Tuck.parse(text) for text in fitting.tuck]
    holds = [Hold.parse(text) for text in fitting.hold]
    return Outfit(body, load_outfit(garments, body, report, templates, how, fitting.fabric, tucks, holds))


def load_wanted_method(
    command: Rollout | TryOn,
    outfit: Outfit,
    finish: FinishName | None = None,
    dynamics: float | None = None,
) -> tuple[Method, bool, str | None]:
    """The method of a command with its finish, whether clearing comes after it, and a line on its choice.

    dynamics: as `ready_method` has it.
    """
    models, line = named_models(command.model or (AUTO,), outfit)
    return *ready_method(models, outfit, finish, command.quality, command.fitting.fabric, dynamics), line
