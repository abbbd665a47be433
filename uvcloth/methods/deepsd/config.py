"""Settings of DeePSD: the paper's, ours, and a switch for each difference and each ablation."""

from dataclasses import dataclass
from typing import Literal

from uvcloth.errors import InputError
from uvcloth.files.settings import require_settings

RANGES = {
    "spread": (0, 1),
    "seen_joints": (0, 1),
    "influences": (1, 1000),
    "keys": (0, 4096),
    **dict.fromkeys(
        ("convolutions", "global_layers", "weight_layers", "shape_layers", "pose_layers"), (1, 4096)
    ),
}
MOST_LAYERS = 64


@dataclass(frozen=True)
class DeePSDConfig:
    """Sizes, inputs and outputs of the network."""

    inputs: Literal["mesh", "body"] = "body"
    """Input of a vertex: position and normal (mesh, paper), or also its offset from the closest point of the
    skin and its smooth blend weights (body)."""
    blend_weights: Literal["learned", "changed", "smooth"] = "smooth"
    """Predicted (learned, paper), predicted as a change of the smooth ones (changed), or the smooth ones."""
    influences: int = 4
    """Number of joints that may move a vertex, the strongest (paper: all); every engine plays four. The
    weight of the next one is subtracted from each, so that weights are continuous over the cloth."""
    deformation: Literal["blend_shapes", "offsets", "none"] = "blend_shapes"
    """Blend shapes weighted by the pose's keys (paper), offsets from descriptor and pose (its Table 1), or
    skinning alone (its Table 6)."""
    convolutions: tuple[int, ...] = (32, 64, 128, 256)
    """Channels of the graph convolutions."""
    spread: float = 0.03
    """Radius of a graph convolution in metres (root mean square), so that a finer mesh of a garment gets the
    same rig; 0: a vertex and its neighbours (paper)."""
    global_layers: tuple[int, ...] = ()
    """Widths of the layers before max pooling over the outfit (paper: 256); empty: no global descriptor,
    which overfits to a few dozen outfits."""
    weight_layers: tuple[int, ...] = (128, 64, 32)
    """Widths of the hidden layers that predict blend weights."""
    shape_layers: tuple[int, ...] = (256, 256, 256)
    """Widths of the hidden layers that predict blend shapes."""
    reads_fabric: bool = True
    """The descriptor of a vertex contains the fabric of its garment (paper: in its Table 2 alone)."""
    graph_heads: bool = False
    """Graph convolutions also after the descriptor, instead of layers per vertex (its Table 1)."""
    seen_joints: float = 0.02
    """Share of an outfit that a joint and its descendants have to move (smooth blend weights) to be an input
    of the outfit's keys; from half of it with reduced weight. 0: all joints (paper)."""
    standardized: bool = True
    """Inputs, poses included, are differences from the training mean in standard deviations, and layers start
    with outputs of zero mean and unit variance (paper: no)."""
    pose_layers: tuple[int, ...] = (128,)
    """Widths of the hidden layers of the pose embedding (paper: 256, 256, 256)."""
    keys: int = 128
    """Number of pose keys and blend shapes; 0: the pose is used as keys (its Table 1)."""

    def __post_init__(self) -> None:
        """Raises InputError for invalid sizes."""
        require_settings(self, RANGES)
        if not self.convolutions:
            raise InputError("--convolutions: has to be one number or more")
        if self.deformation == "none" and self.blend_weights == "smooth":
            raise InputError("--deformation none: leaves nothing to train with --blend-weights smooth")
        for name in ("convolutions", "global_layers", "weight_layers", "shape_layers", "pose_layers"):
            if len(getattr(self, name)) > MOST_LAYERS:
                raise InputError(f"--{name.replace('_', '-')}: has to be {MOST_LAYERS} numbers at most")


PRESETS: dict[str, DeePSDConfig] = {
    "default": DeePSDConfig(),
    "paper": DeePSDConfig(
        inputs="mesh",
        blend_weights="learned",
        influences=99,
        spread=0.0,
        global_layers=(256,),
        reads_fabric=False,
        seen_joints=0.0,
        standardized=False,
        pose_layers=(256, 256, 256),
    ),
    "tiny": DeePSDConfig(
        convolutions=(8, 16),
        global_layers=(16,),
        weight_layers=(16,),
        shape_layers=(16,),
        pose_layers=(16,),
        keys=8,
    ),
}
