"""The methods that can be trained, by name. The table imports none of them, so that help texts are quick."""

from importlib import import_module

from .trainer import TrainerEntry

TRAINERS = {
    "physxnet": ".physxnet.run:ENTRY",
    "motion_guided": ".motion_guided.run:ENTRY",
    "recurrent": ".recurrent.run:ENTRY",
    "pbns": ".pbns.run:ENTRY",
    "deepsd": ".deepsd.run:ENTRY",
    "wrinkles": ".wrinkles.run:ENTRY",
}
"""Every trainer by the name of its method: where its entry is, "module:NAME"."""


def trainer(method: str) -> TrainerEntry:
    """The trainer of one of TRAINERS."""
    module, _, name = TRAINERS[method].partition(":")
    entry: TrainerEntry = getattr(import_module(module, __package__), name)
    return entry
