"""Rollouts that are ready to begin: a method, an outfit and a motion that go together."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from uvcloth.errors import InputError
from uvcloth.garments.garment import Outfit
from uvcloth.garments.proxy import ProxiedOutfit
from uvcloth.geometry.records import CPU
from uvcloth.methods.capabilities import with_dynamics
from uvcloth.methods.ensemble import Ensemble, in_order
from uvcloth.methods.finish_names import FinishName
from uvcloth.methods.method import Method, require_fabric_read
from uvcloth.methods.physics.finish import finished
from uvcloth.methods.physics.method import Physics
from uvcloth.methods.physics.outfit import PhysicsConfig
from uvcloth.methods.registry import load_method
from uvcloth.motion.clip import Clip
from uvcloth.motion.cycle import Cycle, make_cycle
from uvcloth.motion.lead_in import pose_from_rest
from uvcloth.rollouts.looped import looped
from uvcloth.rollouts.rollout import RolloutFrame, rollout_proxied, with_proxies


@dataclass(frozen=True)
class ReadyRollout:
    """A rollout before its first frame.

    proxied: the outfit, its coarse garments carried by proxies where they are cleared. motion: of a pose, the
    way into it from rest; of a loop, the cycle, whose last frame is the first one again. transforms:
    (F, J, 3, 4) float64, the joints of the motion. cycle: of a loop.
    """

    method: Method
    proxied: ProxiedOutfit
    motion: Clip
    transforms: Tensor
    clear: bool
    cycle: Cycle | None = None

    @property
    def lines(self) -> tuple[str, ...]:
        """A sentence on the cycle of a loop, and on each garment that is carried by a proxy."""
        return *((self.cycle.line(),) if self.cycle else ()), *self.proxied.lines

    def frames(
        self, device: torch.device = CPU, every: int = 1, keep_going: bool = False
    ) -> Iterator[RolloutFrame]:
        """Predict the frames, as `rollout_proxied` does; they are relative to origins of their own.

        A loop has all of them, whatever `every` is.
        """

        def roll_out(transforms: Iterable[Tensor], first: int = 0) -> Iterator[RolloutFrame]:
            return rollout_proxied(
                self.method,
                self.proxied,
                transforms,
                self.motion.fps,
                self.clear,
                device=device,
                every=every if self.cycle is None else 1,
                keep_going=keep_going,
                first=first,
            )

        return roll_out(self.transforms) if self.cycle is None else looped(roll_out, self.cycle)


def ready_method(
    models: Sequence[str],
    outfit: Outfit,
    finish: FinishName | None,
    quality: str,
    fabrics: Sequence[str],
    dynamics: float | None = None,
) -> tuple[Method, bool]:
    """Load the method that models make in order with its finish, and tell whether clearing comes after it.

    finish: as `finished` has it. quality: of the solver, a key of QUALITIES. fabrics: by name, those that
    were asked for. dynamics: factor that was asked for, before the finish. Raises InputError as
    `load_method`, `with_dynamics` and `finished` do, and for a fabric that the method does not read.
    """
    solver = Physics(PhysicsConfig(quality))
    loaded = [load_method(model, outfit.body) for model in models]
    method = in_order([solver if isinstance(each, Physics) else each for each in loaded])
    if dynamics is not None:
        method = with_dynamics(method, dynamics)
    method, clear = finished(method, outfit, finish, solver)
    for fabric in fabrics:
        require_fabric_read(method, fabric)
    return method, clear


def ready_rollout(
    method: Method,
    outfit: Outfit,
    motion: Clip,
    clear: bool = True,
    proxies: bool = True,
    loop: bool = False,
) -> ReadyRollout:
    """Bring a method, an outfit and a motion on its body together.

    proxies: carry coarse garments by finer ones where there is clearing. loop: close the motion into a cycle,
    over which the garments come back to where they start. A motion of one frame, a pose, becomes the way into
    it from rest. Raises InputError for an outfit that the method cannot dress, a motion on another body than
    the outfit's, and as `make_cycle` does.
    """
    if reason := method.unsupported_reason(outfit):
        several = not isinstance(method, Ensemble) and len(outfit.garments) > 1
        hint = "; each garment may have a model of its own, as in --model A B" if several else ""
        raise InputError(reason + hint)
    require_same_skeleton(motion, outfit)
    cycle = make_cycle(motion) if loop else None
    motion = pose_from_rest(motion, outfit.body) if cycle is None else cycle.motion
    proxied = with_proxies(outfit, method) if clear and proxies else ProxiedOutfit.as_is(outfit)
    return ReadyRollout(method, proxied, motion, motion.transforms(torch.float64), clear, cycle)


def require_same_skeleton(motion: Clip, outfit: Outfit) -> None:
    """Raise InputError for a motion on another skeleton than that of the outfit's body."""
    one, other = motion.skeleton, outfit.body.skeleton
    if one.names != other.names or not torch.equal(one.heads, other.heads):
        raise InputError(
            f"{motion.name}: was loaded for another body than {outfit.body.name}, which wears the garments; "
            "load it for that body"
        )


def find_device(name: str) -> torch.device:
    """Find the device of a name, as torch has it. Raises InputError if this machine has none such."""
    try:
        device = torch.device(name)
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"--device {name}: is not available on this machine") from error
    return device
