"""The methods that can be trained, by name."""

from train.deepsd import run as deepsd
from train.motion_guided import run as motion_guided
from train.pbns import run as pbns
from train.physxnet import run as physxnet
from train.recurrent import run as recurrent
from train.trainer import TrainerEntry

TRAINERS: dict[str, TrainerEntry] = {
    "physxnet": physxnet.ENTRY,
    "motion_guided": motion_guided.ENTRY,
    "recurrent": recurrent.ENTRY,
    "pbns": pbns.ENTRY,
    "deepsd": deepsd.ENTRY,
}
