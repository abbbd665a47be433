"""The compiler of the system, which some machines do not have."""

import os
import shlex
import shutil


def compiler(variable: str, *names: str) -> list[str]:
    """The command of a compiler, of an environment variable or by name; empty if there is none."""
    commands = map(shlex.split, (os.environ.get(variable, ""), *names))
    return next((command for command in commands if command and shutil.which(command[0])), [])
