"""What can go wrong with what a user hands in; every message names what came, what was expected and what to do."""


class InputError(ValueError):
    """A file's content cannot be used; the command line ends with exit code 3."""


class UsageError(ValueError):
    """Something named in the call does not exist; the command line ends with exit code 2."""


class ModelError(InputError):
    """A model file is unknown, incomplete or impossible."""


class UnknownModelError(ModelError, UsageError):
    """No model goes by that name."""


class LogError(InputError):
    """A log of spots cannot be read as one."""
