"""The methods that can be trained, by name."""

from .deepsd import run as deepsd
from .motion_guided import run as motion_guided
from .pbns import run as pbns
from .physxnet import run as physxnet
from .recurrent import run as recurrent
from .trainer import TrainerEntry

TRAINERS: dict[str, TrainerEntry] = {
    "physxnet": physxnet.ENTRY,
    "motion_guided": motion_guided.ENTRY,
    "recurrent": recurrent.ENTRY,
    "pbns": pbns.ENTRY,
    "deepsd": deepsd.ENTRY,
}
