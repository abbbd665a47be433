"""A command: its options here, what it does in the module of the same name in `uvcloth.commands.run`.

They are apart because `uvcloth --help` reads the options of all commands, while the work imports torch.
"""

from importlib import import_module


class Command:
    """Base of the options of a command: a frozen dataclass, whose fields are its options."""

    def check(self) -> None:
        """Raise InputError for options that do not go together, or a package that is missing."""

    def run(self) -> None:
        """Do what the options ask for. Raises InputError for bad input."""
        self.check()
        name = type(self).__module__.rpartition(".")[2]
        import_module(f"uvcloth.commands.run.{name}").run(self)
