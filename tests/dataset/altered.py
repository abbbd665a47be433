"""Clips of one garment with something changed."""

from collections.abc import Mapping
from typing import Any

from uvcloth.dataset.clip import SimulatedClip, clip_of_garment, flat_metadata


def altered(clip: SimulatedClip, metadata: Mapping[str, Any] | None = None, **fields: Any) -> SimulatedClip:
    """The clip with other fields of it or of its garment, and with more or other metadata."""
    (garment,) = clip.garments
    kept = {
        **{name: getattr(garment, name) for name in ("vertices", "faces", "rest")},
        **{name: getattr(clip, name) for name in ("transforms", "fps", "warm_up")},
    }
    return clip_of_garment(
        **{**kept, **fields}, metadata={**flat_metadata(clip, garment), **(metadata or {})}
    )
