"""Exit codes of the command line, and the error that means wrong usage."""

OK = 0
MODEL_ERROR = 1
USAGE = 2
NUMERICAL_FAILURE = 3
BUG = 70
INTERRUPTED = 130


class UsageError(Exception):
    """The user asked for something that cannot be done; the message says why."""
