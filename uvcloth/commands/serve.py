"""`uvcloth serve`: its options."""

from dataclasses import dataclass

from uvcloth.errors import InputError


@dataclass(frozen=True)
class Serve:
    """Run commands for another program that holds on to this process, as the extension for Blender does."""

    stdio: bool = False
    """Speak over the standard streams, a JSON object a line (docs/library.md)."""

    def run(self) -> None:
        """Serve until the other program closes its end. Raises InputError without `stdio`."""
        if not self.stdio:
            raise InputError("uvcloth serve: expected --stdio, the one way in which it serves")
        from uvcloth.commands.served import serve_standard_streams

        serve_standard_streams()
