"""What is checked of a random model, one function for each claim."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from random import Random

import numpy as np
from judging import Case, Different, Floats
from making.text import Block

from hierc.grammar.problems import ModelError


class Tried:
    """A random model with a time and a state for it; all of it follows from the seed."""

    def __init__(self, block: Block, seed: int) -> None:
        self.block, self.rng, self.numbers = block, Random(seed), np.random.default_rng(seed)
        self.case = Case(block.text())
        self.t = float(self.numbers.uniform(0, 3))
        self.x: Floats = self.numbers.uniform(-2, 2, len(self.case.model.states))

    def start(self) -> None:
        """Initial values and error scales, at several starts."""
        self.case.check_start(0.0)
        self.case.check_start(self.t)

    def rates(self) -> None:
        """Derivatives and all variables."""
        self.case.check_rates(self.t, self.x)

    def jacobian(self) -> None:
        """Two columns of the Jacobian."""
        columns = {self.rng.randrange(len(self.x)) for _ in range(2 * bool(len(self.x)))}
        self.case.check_jacobian(self.t, self.x, sorted(columns))

    def parameters(self) -> None:
        """Other values for parameters, given by path when the model is there already."""
        given: dict[str, object] = {}
        for path, parameter in self.case.model.parameters.items():
            if self.rng.random() < 0.5 and not parameter.structural:
                kind = next(
                    p.kind for p in self.case.model.plan.parameters if p.path.replace("[]", "") == path
                )
                real = self.numbers.uniform(0.5, 2, np.shape(parameter.value)).tolist()
                given[path] = (
                    real
                    if kind == "real"
                    else np.full(np.shape(parameter.value), self.numbers.integers(0, 2)).tolist()
                )
        other = Case(self.case.text, params=given)
        other.check_rates(self.t, self.x)
        other.check_start(0.0)

    def order(self) -> None:
        """Another order of declarations, equations and blocks."""
        self.same(self.block.shuffled(self.rng).text())

    def format(self) -> None:
        self.case.check_format()

    def machine(self) -> None:
        """All functions as machine code."""
        self.case.check_machine_code(self.numbers)

    def same(self, text: str, renamed: Callable[[str], str] = str) -> None:
        """Another text with the same initial values and derivatives, to the last bit. `renamed`: what a state is called there."""
        other = Case(text)
        at = {renamed(path): value for path, value in self.case.by_path(self.x).items()}
        moved = np.array(other.vector(at), np.float64)
        for what, ours, theirs in (
            ("initial value", self.case.model.initial(self.t), other.model.initial(self.t)),
            ("derivative", self.case.model.rhs(self.t, self.x), other.model.rhs(self.t, moved)),
        ):
            found = other.by_path(theirs)
            for path, value in self.case.by_path(ours).items():
                if not np.array_equal(found[renamed(path)], value, equal_nan=True):
                    raise Different(f"{what} of `{path}`: {found[renamed(path)]} for {value}")


#: What is tried of every model, and what of some.
ALWAYS = ("start", "rates")
SOME = ("jacobian", "parameters", "order", "format")


def attempt(block: Block, seed: int, names: tuple[str, ...]) -> Exception | None:
    """The first problem; None also where nothing is left to judge: a number known when compiling has no finite value."""
    try:
        tried = Tried(block, seed)
        for name in names:
            getattr(tried, name)()
    except ModelError as error:
        return None if codes(error) == {"E581"} else error
    except Exception as error:
        return error
    return None


def codes(error: ModelError) -> set[str]:
    """What is wrong, without warnings."""
    return {p.code for p in error.problems if p.code.startswith("E")}


def reduced(block: Block, seed: int, names: tuple[str, ...], kind: type[Exception]) -> Block:
    """A smaller model with a problem of the same kind."""

    def fails(smaller: Block) -> bool:
        return type(attempt(smaller, seed, names)) is kind

    before = ""
    while block.text() != before:  # what uses others goes first
        before = block.text()
        for path in reversed(list(_paths(block))):
            smaller = _without(block, path)
            if fails(smaller):
                block = smaller
    return block


def _paths(block: Block) -> Iterator[tuple[int, ...]]:
    """The ways to all items, outer ones first."""
    for k, item in enumerate(block.items):
        yield (k,)
        if isinstance(item, Block):
            yield from ((k, *rest) for rest in _paths(item))


def _without(block: Block, path: tuple[int, ...]) -> Block:
    items = list(block.items)
    if len(path) == 1:
        del items[path[0]]
    else:
        inner = items[path[0]]
        assert isinstance(inner, Block)
        items[path[0]] = _without(inner, path[1:])
    return Block(block.head, items)
