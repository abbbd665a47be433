"""Names of the last steps after a prediction, without heavy imports."""

from typing import Literal, get_args

FinishName = Literal["dynamic", "static", "clear", "none"]
"""The solver moves the garments, or lets them come to rest; clearing moves them off the body; or nothing."""

FINISHES: tuple[FinishName, ...] = get_args(FinishName)
