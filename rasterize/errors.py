"""The error for bad input."""


class InputError(ValueError):
    """Bad input from a user: the message is one sentence that names the file and the place."""
