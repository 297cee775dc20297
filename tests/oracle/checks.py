"""What is checked of a random model, one function for each claim."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from random import Random

import numpy as np
from judging import Case, Different, Floats
from making.rewriting import split, without_groups
from making.text import Block

from hierc.grammar.problems import ModelError

#: What `group` statements at random lead to: groups that need each other in a circle.
CIRCLES = {"E602", "E603"}


class Tried:
    """A random model with a time and a state for it; all of it follows from the seed."""

    def __init__(self, block: Block, seed: int) -> None:
        self.block, self.rng, self.numbers = block, Random(seed), np.random.default_rng(seed)
        self.case = Case(block.text())
        try:
            self.case.model  # noqa: B018
        except ModelError as error:
            if not codes(error) or not codes(error) <= CIRCLES:
                raise
            self.block = without_groups(block)
            self.case = Case(self.block.text())
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
        """Two columns of the Jacobian. Those of external functions are differences themselves."""
        if "extern " in self.case.text:
            return
        columns = {self.rng.randrange(len(self.x)) for _ in range(2 * bool(len(self.x)))}
        self.case.check_jacobian(self.t, self.x, sorted(columns))

    def parameters(self) -> None:
        """Other values for parameters, given by path: structural ones, with which it is compiled once more, and others when it is there already."""
        chosen = {path: p for path, p in self.case.model.parameters.items() if self.rng.random() < 0.5}
        # The sizes of an agent inside are what the one around it says.
        given: dict[str, object] = {
            path: self._structural(path) for path, p in chosen.items() if p.structural and "." not in path
        }
        for path, p in chosen.items():
            if not p.structural and not (given and p.shape):
                shape = p.shape if given else np.shape(p.value)  # one for all where there may be fewer now
                real = self.numbers.uniform(0.5, 2, shape).tolist()
                given[path] = (
                    real if p.kind == "real" else np.full(shape, self.numbers.integers(0, 2)).tolist()
                )
        other = Case(self.case.text, params=given)
        other.check_rates(self.t, self.numbers.uniform(-2, 2, len(other.model.states)))
        other.check_start(0.0)

    def _structural(self, path: str) -> int | list[int]:
        """A value that any size or index may have, or any flag."""
        parameter = next(p for p in self.case.model.plan.parameters if p.path == path)
        if parameter.kind == "int":
            return 2
        return np.full(parameter.shape, self.numbers.integers(0, 2)).tolist()

    def files(self) -> None:
        """In several files."""
        main, others = split(self.case.text, self.rng)
        self.same(main, files=others)

    def order(self) -> None:
        """Another order of declarations, equations and blocks."""
        self.same(self.block.shuffled(self.rng).text())

    def format(self) -> None:
        self.case.check_format()

    def machine(self) -> None:
        """All functions as machine code."""
        self.case.check_machine_code(self.numbers)

    def same(
        self, text: str, renamed: Callable[[str], str] = str, files: Mapping[str, str] | None = None
    ) -> None:
        """Another text with the same initial values and derivatives, to the last bit. `renamed`: what a state is called there."""
        other = Case(text, files=files or {})
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
SOME = ("jacobian", "parameters", "order", "format", "files")


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
