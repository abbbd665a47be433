"""`uvcloth serve`: its options."""

from dataclasses import dataclass

from uvcloth.commands.command import Command
from uvcloth.errors import InputError


@dataclass(frozen=True)
class Serve(Command):
    """Run commands for another program that holds on to this process, as the extension for Blender does."""

    stdio: bool = False
    """Speak over the standard streams, a JSON object a line (docs/library.md)."""

    def check(self) -> None:
        """See Command."""
        if not self.stdio:
            raise InputError("uvcloth serve: expected --stdio, the one way in which it serves")
