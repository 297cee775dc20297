"""The errors that mean: what the user gave does not fit. Everything else that a run raises is a fault of ours."""


class SettingError(ValueError):
    """A setting or parameter value that cannot be used; the message names it and says what would fit."""


class RunWarning(UserWarning):
    """Something about a run that its user should know, though it went on."""


class ExternError(RuntimeError):
    """An external function of a model that is not there, or that did not return a number."""

    def __init__(self, name: str, target: str, reason: str) -> None:
        self.name, self.target, self.reason = name, target, reason
        super().__init__(f"extern `{name}` ({target}): {reason}")
