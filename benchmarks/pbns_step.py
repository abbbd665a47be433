"""How a training step of PBNS spends its time, and what its closest points cost done otherwise.

`python -m benchmarks.pbns_step --poses poses.npz`: shares of a step, once as the network begins to learn and once
as it settles; beside it, what the same queries take when nothing is remembered of the last visit.
"""

import sys
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import torch
import tyro

from rasterize.command import run_command
from train.loop import rows_of_step
from train.pbns import LOOPS, Fabric, Hanging, PBNSObjective
from train.poses import poses_for
from uvcloth.bodies.body import load_body
from uvcloth.garments.garment import Outfit
from uvcloth.garments.wardrobe import take
from uvcloth.methods.pbns import PBNSConfig
from uvcloth.skinning import skin
