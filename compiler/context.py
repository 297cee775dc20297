"""What every phase after the constants works with."""

from __future__ import annotations

from dataclasses import dataclass

from hierc.compiler.collector import Collector
from hierc.compiler.resolve.constants import UNSHARED, ByName
from hierc.compiler.resolve.declarations import Library
from hierc.compiler.resolve.names import Names
from hierc.compiler.shapes.environment import Budget, Environment, Values


@dataclass(frozen=True, slots=True)
class Context:
    """A file whose names are right: its definitions, its constants' values, and where problems go."""

    library: Library
    names: Names
    constants: ByName
    budget: Budget
    problems: Collector

    def environment(self) -> Environment:
        """The scope of the file: constants, and nothing to share."""
        return Environment(self.library, self.constants, Values(self.constants), UNSHARED, self.budget)
