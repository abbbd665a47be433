"""Every reader that is tried, by name."""

from tests.fuzz import (
    array_targets,
    cloth3d_targets,
    file_targets,
    line_targets,
    model_targets,
    run_targets,
    smpl_targets,
    text_targets,
)
from tests.fuzz.target import Target

MODULES = (
    *(array_targets, cloth3d_targets, file_targets, model_targets),
    *(line_targets, run_targets, smpl_targets, text_targets),
)

TARGETS: dict[str, Target] = {target.name: target for module in MODULES for target in module.TARGETS}
