"""The one error for bad input; every command prints its sentence and exits with code 2."""


class InputError(ValueError):
    """Bad input from a user: the message is one sentence that names the file and the place."""
