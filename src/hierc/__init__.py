"""hierc: a compiler and multirate simulator for hierarchical models of robots and other controlled systems.

    import hierc
    model = hierc.load("cart.hier")
    r = model.simulate(stop=50, rtol=1e-8)
    r["cart.x"], r("cart.x", 1.5), r.stats

Everything is imported on first use, so `import hierc` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from hierc.version import __version__

if TYPE_CHECKING:
    from hierc.grammar.problems import ModelError
    from hierc.loader import compile, load
    from hierc.runtime.errors import ExternError, RunWarning, SettingError
    from hierc.runtime.model import Model
    from hierc.runtime.result import Interrupted, Result, SimulationError

__all__ = [
    "ExternError",
    "Interrupted",
    "Model",
    "ModelError",
    "Result",
    "RunWarning",
    "SettingError",
    "SimulationError",
    "__version__",
    "compile",
    "load",
]

_HOMES = {
    "ExternError": "hierc.runtime.errors",
    "Interrupted": "hierc.runtime.result",
    "Model": "hierc.runtime.model",
    "ModelError": "hierc.grammar.problems",
    "Result": "hierc.runtime.result",
    "RunWarning": "hierc.runtime.errors",
    "SettingError": "hierc.runtime.errors",
    "SimulationError": "hierc.runtime.result",
    "compile": "hierc.loader",
    "load": "hierc.loader",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module `hierc` has no attribute `{name}`")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
