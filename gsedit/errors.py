"""Errors that a user can cause, by kind. A message names the file, the place and the next move."""


class GseditError(Exception):
    """Anything that a user's input or request caused."""


class UsageError(GseditError):
    """The request itself cannot be met: an option, an instruction, a combination (exit code 2)."""


class InputError(GseditError):
    """A file or folder cannot be read as what it should be (exit code 3)."""
