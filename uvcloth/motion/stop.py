"""Sudden stops: a motion brakes within a few frames and stands still in its last pose."""

import torch

from uvcloth.motion.clip import Clip
from uvcloth.motion.retarget import at_times

BRAKING_SECONDS = 0.2
"""Seconds in which the speed of a motion falls to zero."""


def come_to_rest(clip: Clip, seconds: float) -> Clip:
    """Brake a motion to a standstill in its last pose, and stand there: `seconds` more than the clip has.

    Time runs slower over the clip's last BRAKING_SECONDS / 2, which then take BRAKING_SECONDS. With u from 0
    to 1 over the braking, the speed is 1 - 3 u^2 + 2 u^3 of the clip's: its acceleration is continuous as
    well.
    """
    last = len(clip) - 1
    added = round(seconds * clip.fps)
    braking = 2 * min(round(BRAKING_SECONDS * clip.fps / 2), last, added)
    begin = last - braking // 2
    u = (torch.arange(1, added + braking // 2 + 1, dtype=torch.float64) / max(braking, 1)).clamp(max=1.0)
    braked = begin + braking * (u - u**3 + 0.5 * u**4)
    return at_times(clip, torch.cat([torch.arange(begin + 1, dtype=torch.float64), braked]))
