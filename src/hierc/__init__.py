"""hierc: a compiler and multirate simulator for hierarchical models."""

from hierc.version import __version__

__all__ = ["__version__"]
