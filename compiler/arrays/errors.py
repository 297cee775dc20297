"""Problems with arrays of agents (E8xx)."""

from __future__ import annotations

from dataclasses import dataclass

from hierc.compiler.suggest import listed
from hierc.grammar.problems import Problem


@dataclass(frozen=True)
class OutOfArray(Problem):
    code = "E801"
    explanation = (
        "An index of an array of agents lies in the range that the array was declared with, for every element. An `if` on indices alone is decided "
        "when compiling, so its other branch may name what is not there."
    )
    text: str  # `car[i - 1]`
    index: int
    first: int
    last: int
    where: tuple[str, ...]  # `i = 1`: the indices of the first element for which it is
    index_name: str | None  # of the array whose element asks

    def title(self) -> str:
        if not self.where:
            return f"`{self.text}` is out of range: there is no element {self.index}"
        return f"`{self.text}` is out of range for {listed(self.where)}"

    def notes(self) -> tuple[str, ...]:
        return (f"the indices are {self.first} to {self.last}",)

    def help(self) -> tuple[str, ...]:
        if self.index_name is None:
            return ()
        condition = self.where[-1].replace("=", "==")
        return (f"decide by the index: `if {condition} then … else {self.text}…`",)


@dataclass(frozen=True)
class CountsDiffer(Problem):
    code = "E802"
    explanation = "What is given to agents of an array at once is one value for all of them, or a value for each, in the order of their indices."
    text: str
    wanted: int
    given: int

    def title(self) -> str:
        return f"`{self.text}` means {self.wanted} agents, but {self.given} values are given"


@dataclass(frozen=True)
class IndexAssigned(Problem):
    code = "E803"
    explanation = "The index of a `for` or of an array of agents counts elements; it is known when the model is compiled and never changes."
    name: str

    def title(self) -> str:
        return f"`{self.name}` is an index, not a value that changes; it cannot be defined"


@dataclass(frozen=True)
class TooManyPatterns(Problem):
    code = "E804"
    explanation = (
        "Elements of an array that are coupled alike share their equations. Where conditions on indices, sizes or lengths of slices, but those of a sum or "
        "an extreme, differ from element to element, each kind needs equations of its own, and there may not be too many kinds."
    )
    name: str
    count: int
    limit: int

    def title(self) -> str:
        return f"the elements of `{self.name}` are coupled in {self.count} different ways; the limit is {self.limit}"

    def help(self) -> tuple[str, ...]:
        return (
            "let the index choose what is read, as in `car[i - 1]` or `parent[i]`",
            "over as many as the index says, take `sum`, `min` or `max`: `sum(car[1..i].x)`, `sum([car[k].x^2 for k in 1..i])`",
        )


@dataclass(frozen=True)
class EmptyArray(Problem):
    code = "E805"
    explanation = "An array of agents has at least one element, and so has what an experiment names of one."
    name: str
    first: int
    last: int

    def title(self) -> str:
        return f"`{self.name}[{self.first}..{self.last}]` has no elements"


@dataclass(frozen=True)
class NotAnArray(Problem):
    """`group each` of what is no array, or a subscript after a single agent."""

    code = "E806"
    explanation = "`group each car;` and subscripts as in `car[2].x` are for arrays of agents, declared as `agent car[i in 1..N] = …`."
    name: str
    arrays: tuple[str, ...]

    def title(self) -> str:
        return f"`{self.name}` is no array of agents"

    def help(self) -> tuple[str, ...]:
        return (f"the arrays here are {listed(self.arrays)}",) if self.arrays else ()


@dataclass(frozen=True)
class StructuralElement(Problem):
    code = "E807"
    explanation = (
        "A structural parameter decides sizes and couplings. It may differ between the elements of an array by its argument, not by what an "
        "experiment gives to some of them."
    )
    name: str
    path: str

    def title(self) -> str:
        return f"structural parameter `{self.name}` cannot be given for single elements"

    def help(self) -> tuple[str, ...]:
        return (
            f"give it for all of them, `{self.path} = …`, or write its argument as an expression of the index",
        )


@dataclass(frozen=True)
class ShapesOfElements(Problem):
    code = "E808"
    explanation = "What an index chooses from an array of agents has one shape for all of its elements."
    name: str

    def title(self) -> str:
        return f"`{self.name}` does not have the same shape in all elements"


@dataclass(frozen=True)
class NegativeIndex(Problem):
    code = "E809"
    explanation = "The indices of an array of agents are whole numbers from 0 on, so that its agents can be named: `car[3]`."
    name: str
    first: int

    def title(self) -> str:
        return f"the indices of `{self.name}` begin at {self.first}, below 0"

    def help(self) -> tuple[str, ...]:
        return ("begin at 1, and compute with the index what differs",)
