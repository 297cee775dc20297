"""The error that means: what the caller gave does not fit. Everything else that a run raises is a fault of ours."""


class SettingError(ValueError):
    """A setting or parameter value that cannot be used; the message names it and says what would fit."""
