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
    """Sizes of the network, what it reads and what it predicts."""

    inputs: Literal["mesh", "body"] = "body"
    """What a vertex brings: position and normal (mesh, paper), or besides its offset from the closest point
    of the skin and its smooth blend weights (body)."""
    blend_weights: Literal["learned", "changed", "smooth"] = "smooth"
    """Predicted alone (learned, paper), as a change of the smooth ones of the baseline, or those."""
    influences: int = 4
    """Joints that may move a vertex, the strongest (paper: all): four are what every engine plays. The weight
    of the next one is taken off each, so that weights are continuous over the cloth."""
    deformation: Literal["blend_shapes", "offsets", "none"] = "blend_shapes"
    """Blend shapes weighed by the pose's keys (paper), offsets from descriptor and pose (its Table 1), or
    skinning alone (its Table 6)."""
    convolutions: tuple[int, ...] = (32, 64, 128, 256)
    """Channels of the graph convolutions."""
    spread: float = 0.03
    """Metres, root mean square, from which a graph convolution averages, so that a finer mesh of a garment
    gets the same rig; 0 for the neighbours of a vertex and itself, wherever they are (paper)."""
    global_layers: tuple[int, ...] = ()
    """Widths of the layers before max pooling over the outfit (paper: 256); empty for no global descriptor,
    which overfits to some dozens of outfits."""
    weight_layers: tuple[int, ...] = (128, 64, 32)
    """Widths of the hidden layers that predict blend weights."""
    shape_layers: tuple[int, ...] = (256, 256, 256)
    """Widths of the hidden layers that predict blend shapes."""
    reads_fabric: bool = True
    """Whether the fabric of its garment joins the descriptor of a vertex (paper: in its Table 2 alone)."""
    graph_heads: bool = False
    """Graph convolutions instead of layers per vertex after the descriptor, too (its Table 1)."""
    seen_joints: float = 0.02
    """Share of an outfit that a joint, with all beyond it, has to move by the smooth blend weights, for the
    outfit's keys to see its rotation; from half of it some. 0 for all joints (paper)."""
    standardized: bool = True
    """Whether what the network reads, poses too, is told by the difference from its mean in training, in
    standard deviations, and layers begin with outputs of zero mean and unit variance (paper: no)."""
    pose_layers: tuple[int, ...] = (128,)
    """Widths of the hidden layers of the pose embedding (paper: 256, 256, 256)."""
    keys: int = 128
    """Pose keys, and blend shapes; 0 takes the pose itself as keys (its Table 1)."""

    def __post_init__(self) -> None:
        """Raises InputError for sizes that are none."""
        require_settings(self, RANGES)
        if not self.convolutions:
            raise InputError("--convolutions: has to be one number or more")
        if self.deformation == "none" and self.blend_weights == "smooth":
            raise InputError("--deformation none: leaves nothing to learn, with --blend-weights smooth")
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
