"""Random expressions of a wanted shape and unit over the names of a scope.

Sizes are texts: `3`, or the name of a parameter or constant that is at least 2. Two shapes are equal if their texts are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from random import Random

from making.units import COMMON, ONE, SECOND, Unit, Writer, over, times

Shape = tuple[str, ...]


@dataclass(frozen=True)
class Text:
    """An expression with how tightly it binds: 0 `if`, 1 `or`, 2 `and`, 3 `not`, 4 comparison, 5 `+`, 6 `*`, 7 sign, 8 `^`, 9 atom."""

    text: str
    binds: int = 9

    def at(self, least: int) -> str:
        """The text where something that binds at least so tightly must stand."""
        return self.text if self.binds >= least else f"({self.text})"

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True)
class Leaf:
    """A name that may be used, or a sum over agents. `safe`: its initial value is known early, so initial values may use it. `array`: of an array of
    agents. `names`: those of which the index of a `for` would make something else.
    """

    text: str
    shape: Shape
    unit: Unit
    safe: bool = False
    array: bool = False
    names: tuple[str, ...] = ()

    def means(self, name: str) -> bool:
        """Whether it is about something of this name."""
        return name in (self.names or (self.text.partition(".")[0].removesuffix("'"),))


@dataclass(frozen=True)
class Func:
    """A function of the file. Sizes `n` and `m` of its shapes are those of its arguments; a unit None is that of an index."""

    name: str
    params: tuple[tuple[Shape, Unit | None], ...]
    shape: Shape
    unit: Unit


@dataclass(frozen=True)
class Scope:
    """What expressions may use. `indices`: names with their ranges, `(name, first, last)`; `whole`: names of ints; `picks`: ints that are 1 or 2."""

    leaves: tuple[Leaf, ...] = ()
    bools: tuple[str, ...] = ()
    whole: tuple[str, ...] = ()
    picks: tuple[str, ...] = ()
    indices: tuple[tuple[str, str, str], ...] = ()
    funcs: tuple[Func, ...] = ()
    timed: bool = False

    def of(self, shape: Shape, unit: Unit) -> list[Leaf]:
        return [leaf for leaf in self.leaves if leaf.shape == shape and leaf.unit == unit]

    def with_leaves(self, *leaves: Leaf) -> Scope:
        return replace(self, leaves=(*self.leaves, *leaves))

    def bind(self, name: str, first: str, last: str) -> Scope:
        """The scope inside a `for`: the index hides what has its name."""
        return replace(
            self,
            leaves=tuple(leaf for leaf in self.leaves if not leaf.means(name)),
            bools=tuple(n for n in self.bools if n != name),
            whole=tuple(n for n in self.whole if n != name),
            picks=tuple(n for n in self.picks if n != name),
            indices=(*(i for i in self.indices if i[0] != name), (name, first, last)),
        )


def known(size: str) -> int | None:
    """The number that a size is; None if it is a name."""
    return int(size) if size.isdigit() else None


@dataclass(frozen=True)
class Maker:
    """Makes expressions in one scope. `loose`: a number may take its neighbour's unit where the expression will stand."""

    rng: Random
    writer: Writer
    scope: Scope
    #: How often something without a value in places may be made, such as the root of a name.
    rash: float = 0.0
    #: How often a large system of equations may be solved.
    heavy: float = 0.0
    used: list[Leaf] = field(default_factory=list)

    def within(self, scope: Scope) -> Maker:
        return replace(self, scope=scope)

    def make(self, shape: Shape, unit: Unit, depth: int, *, loose: bool = False) -> Text:
        """Any expression of this shape and unit."""
        simple = self._leaves(shape, unit)
        if not simple or self.rng.random() < 0.1:
            simple.append(lambda: self._plainly(shape, unit, loose=loose))
        if depth <= 0:
            return self.rng.choice(simple)()
        return self.rng.choice(
            [self.rng.choice(simple), *self._compound(shape, unit, depth - 1, loose=loose)]
        )()

    # ---- the simplest ---------------------------------------------------------------------------------------------------------------

    def number(self, unit: Unit, *, loose: bool = False) -> Text:
        """A literal between a half and three."""
        value = self.rng.choice([1.0, 2.0, 0.5, 3.0, 1.5, 0.25, 2.75])
        return Text(self.writer.number(value, unit, loose=loose))

    def _plainly(self, shape: Shape, unit: Unit, *, loose: bool) -> Text:
        if not shape:
            return self.number(unit, loose=loose)
        if all(known(size) is not None for size in shape) and self.rng.random() < 0.8:
            return Text(
                f"[{', '.join(str(self._plainly(shape[1:], unit, loose=loose)) for _ in range(int(shape[0])))}]"
            )
        # Zeros have no unit, so they stand only where a neighbour's unit is known.
        return self.rng.choice([self._repeated, self._zeros] if loose else [self._repeated])(shape, unit)

    def _repeated(self, shape: Shape, unit: Unit) -> Text:
        name = self._index_name()
        item = self.within(self.scope.bind(name, "1", shape[0]))._plainly(shape[1:], unit, loose=False)
        return Text(f"[{item} for {name} in 1..{shape[0]}]")

    def _zeros(self, shape: Shape, _: Unit) -> Text:
        return Text(f"zeros({', '.join(shape)})")

    def _index_name(self) -> str:
        taken = {*self.scope.whole, *(name for name, _, _ in self.scope.indices)}
        return self.rng.choice([n for n in ("i", "j", "k", "row", "col", "l", "a", "b") if n not in taken])

    def _take(self, leaf: Leaf, text: str | None = None) -> Text:
        self.used.append(leaf)
        return Text(leaf.text if text is None else text)

    def _leaves(self, shape: Shape, unit: Unit) -> list[Callable[[], Text]]:
        """Names of this shape and unit, and elements, rows and slices of larger ones."""
        found: list[Callable[[], Text]] = []
        for leaf in self.scope.leaves:
            if leaf.unit == unit and leaf.shape == shape:
                found.append(lambda leaf=leaf: self._take(leaf))
            elif leaf.unit == unit and len(leaf.shape) >= len(shape) and leaf.shape:
                subs = self._subscripts(leaf.shape, shape)
                if subs is not None:
                    found.append(lambda leaf=leaf, subs=subs: self._subscripted(leaf, subs))
        if shape == () and unit == ONE:
            found += [lambda n=n: Text(n) for n in (*self.scope.whole, *self.scope.picks)]
            found += [lambda n=n: Text(n) for n, _, _ in self.scope.indices]
        if shape == () and unit == SECOND and self.scope.timed:
            found.append(lambda: Text("time") if self.writer.style != "none" else Text("time/(1 [s])", 6))
        return found

    def _subscripted(self, leaf: Leaf, subs: Sequence[Callable[[], str]]) -> Text:
        text, prime = leaf.text.removesuffix("'"), "'" * leaf.text.endswith("'")
        chosen = [sub() for sub in subs]
        owner, _, name = text.partition(".")
        if leaf.array and (".." not in chosen[0] or (len(chosen) == 1 and self.rng.random() < 0.5)):
            text, chosen = f"{owner}[{chosen[0]}].{name}", chosen[1:]
        return self._take(leaf, f"{text}[{', '.join(chosen)}]{prime}" if chosen else f"{text}{prime}")

    def _subscripts(self, sizes: Shape, wanted: Shape) -> list[Callable[[], str]] | None:
        """Subscripts that choose something of a shape from something of another; None if there are none."""
        found: list[Callable[[], str]] = []
        rest = list(wanted)
        for place, size in enumerate(sizes):
            if rest and (len(sizes) - place == len(rest) or self.rng.random() < 0.5):
                part = self._slice(size, rest.pop(0))
                if part is None:
                    return None
                found.append(part)
            else:
                found.append(lambda size=size: self._position(size))
        return None if rest else found

    def _slice(self, size: str, wanted: str) -> Callable[[], str] | None:
        if size == wanted:
            return lambda: f"1..{size}"
        length = known(wanted)
        if length is None or length > (known(size) or 2):
            return None
        first = self.rng.randint(1, (known(size) or 2) - length + 1)
        return lambda: f"{first}..{first + length - 1}"

    def _position(self, size: str) -> str:
        """An index from 1 to a size."""
        fitting = [
            n
            for n, first, last in self.scope.indices
            if last == size or (known(last) or 99) <= (known(size) or 2)
        ]
        choices = [str(self.rng.randint(1, known(size) or 2)), *self.scope.picks, *fitting, *fitting]
        choices += [
            f"{size} + 1 - {n}"
            for n, first, last in self.scope.indices
            if last == size and first in ("1", "2")
        ]
        choices += [f"{n} - 1" for n, first, last in self.scope.indices if last == size and first == "2"]
        choices += [size]
        return self.rng.choice(choices)

    # ---- what is made of parts ------------------------------------------------------------------------------------------------------

    def _compound(self, shape: Shape, unit: Unit, depth: int, *, loose: bool) -> list[Callable[[], Text]]:
        def part(*, loose: bool = False) -> Text:
            return self.make(shape, unit, depth, loose=loose)

        rules: list[Callable[[], Text]] = [
            lambda: self._sum(part(loose=loose), part(loose=True)),
            lambda: self._product(shape, unit, depth),
            lambda: self._quotient(shape, unit, depth),
            lambda: Text(f"-{part(loose=loose).at(7)}", 7),
            lambda: self._choice(part(loose=loose), part(loose=True)),
            lambda: self._product(shape, unit, depth),
            lambda: self._sum(part(loose=loose), part(loose=True)),
        ]
        rules += [
            lambda f=f: self._called(f, shape, depth)
            for f in self.scope.funcs
            if f.unit == unit and _fits(f.shape, shape)
        ]
        rules += [self._flat, self._vector_rules, self._matrix_rules][len(shape)](shape, unit, depth)
        return rules

    def _sum(self, left: Text, right: Text) -> Text:
        return Text(f"{left.at(5)} {self.rng.choice('+-')} {right.at(6)}", 5)

    def _split(self, unit: Unit) -> tuple[Unit, Unit]:
        """Two units whose product is this one."""
        first = self.rng.choice([ONE, ONE, *COMMON])
        return first, over(unit, first)

    def _product(self, shape: Shape, unit: Unit, depth: int) -> Text:
        a, b = self._split(unit)
        parts = [self.make((), a, depth), self.make(shape, b, depth)]
        if self.rng.random() < 0.5:
            parts.reverse()
        return Text(f"{parts[0].at(6)}*{parts[1].at(7)}", 6)

    def _quotient(self, shape: Shape, unit: Unit, depth: int) -> Text:
        below = self.rng.choice([ONE, *COMMON])
        return Text(f"{self.make(shape, times(unit, below), depth).at(6)}/{self.safe(below, depth).at(7)}", 6)

    def safe(self, unit: Unit, depth: int) -> Text:
        """A scalar above zero."""
        number = self.number(unit)
        if self.rng.random() < 0.4:
            return number
        if self.scope.of((), unit) and self.rng.random() < self.rash:
            return self._take(self.rng.choice(self.scope.of((), unit)))
        return Text(f"{number} + abs({self.make((), unit, depth - 1, loose=True)})", 5)

    def _choice(self, then: Text, other: Text) -> Text:
        return Text(f"if {self.condition(1)} then {then} else {other}", 0)

    def condition(self, depth: int) -> Text:
        """A truth value."""
        rules: list[Callable[[], Text]] = [lambda: self._comparison(depth - 1)]
        rules += [lambda n=n: Text(n) for n in self.scope.bools]
        rules += [
            lambda n=n: Text(f"{n} {self.rng.choice(['==', '!=', '>', '<='])} 2", 4)
            for n in (*self.scope.whole, *self.scope.picks)
        ]
        if depth > 0:
            rules += [
                lambda: Text(f"not {self.condition(depth - 1).at(3)}", 3),
                lambda: Text(f"{self.condition(depth - 1).at(2)} and {self.condition(depth - 1).at(3)}", 2),
                lambda: Text(f"{self.condition(depth - 1).at(1)} or {self.condition(depth - 1).at(2)}", 1),
            ]
        return self.rng.choice(rules)()

    def _comparison(self, depth: int) -> Text:
        unit = self.rng.choice([leaf.unit for leaf in self.scope.leaves] or [ONE])
        left, right = self.make((), unit, depth), self.make((), unit, depth, loose=True)
        return Text(f"{left.at(5)} {self.rng.choice(['<', '<=', '>', '>='])} {right.at(5)}", 4)

    def _called(self, func: Func, shape: Shape, depth: int) -> Text:
        """A call of a function of the file; sizes that its value does not tell are any."""
        sizes = dict(zip(func.shape, shape, strict=True))
        args = []
        for wanted, unit in func.params:
            if unit is None:
                args.append(self.rng.choice(["1", "2", *self.scope.picks]))
                continue
            for size in wanted:
                sizes.setdefault(size, size if known(size) else self.rng.choice(["2", "3"]))
            args.append(str(self.make(tuple(sizes[s] for s in wanted), unit, depth, loose=True)))
        return Text(f"{func.name}({', '.join(args)})")

    def size(self) -> str:
        """Some length of a vector: one that is there already, if any."""
        return self.rng.choice([*(leaf.shape[0] for leaf in self.scope.leaves if leaf.shape), "2", "3"])

    # ---- scalars --------------------------------------------------------------------------------------------------------------------

    def _flat(self, shape: Shape, unit: Unit, depth: int) -> list[Callable[[], Text]]:
        def scalar(of: Unit = unit, *, loose: bool = False) -> Text:
            return self.make((), of, depth, loose=loose)

        def vector(of: Unit = unit) -> Text:
            return self.make((self.size(),), of, depth)

        def call(name: str, *args: object) -> Text:
            return Text(f"{name}({', '.join(map(str, args))})")

        rules: list[Callable[[], Text]] = [
            lambda: call("abs", scalar()),
            lambda: call(self.rng.choice(["min", "max"]), scalar(), scalar(loose=True)),
            lambda: call(self.rng.choice(["min", "max", "sum", "norm"]), vector()),
            lambda: call("clamp", scalar(), self.number(unit), self.number(unit)),
            lambda: call("mod", scalar(), self.safe(unit, depth)),
            lambda: call("smooth", scalar()),
            lambda: call("sqrt", f"abs({scalar(times(unit, unit))})"),
            lambda: self._dot(unit, depth),
            lambda: call("trace", self.make((size := self.size(), size), unit, depth)),
            lambda: call("sum", self.make((self.size(), self.size()), unit, depth)),
            lambda: self._added_up(unit, depth),
        ]
        if self.rng.random() < self.heavy:
            rules += [lambda: self._large(unit)] * 3
        if all(e % 2 == 0 for e in unit):
            half: Unit = (unit[0] // 2, unit[1] // 2, unit[2] // 2)
            rules.append(lambda: Text(f"{scalar(half).at(9)}^2", 8))
        return rules + (self._numbers(depth) if unit == ONE else [])

    def _numbers(self, depth: int) -> list[Callable[[], Text]]:
        """Functions of numbers."""

        def inner(rule: str) -> Callable[[], Text]:
            return lambda: Text(rule.format(self.make((), ONE, depth)))

        rules = [inner(f"{name}({{}})") for name in ("sin", "cos", "tanh", "atan", "sin", "cos")]
        rules += [inner(rule) for rule in (
            "exp(-abs({}))", "log(1 + abs({}))", "log10(2 + abs({}))", "sinh(tanh({}))", "cosh(sin({}))", "asin(0.9*sin({}))",
            "acos(0.9*tanh({}))", "tan(atan({}))", "floor({})", "ceil({})", "round({})", "sign({})", "exp(tanh({}))",
        )]  # fmt: skip
        rules.append(
            lambda: Text(
                f"(2 + tanh({self.make((), ONE, depth)}))^{self.rng.choice(['3', '-1', '0.5', '1.5', '-2'])}",
                8,
            )
        )
        rules.append(lambda: self._atan2(depth))
        if self.writer.style == "mixed":
            rules.append(lambda: Text(f"sin({self.rng.choice(['30 [deg]', '2 [mrad]', '50 [%]'])})"))
        named = [leaf for leaf in self.scope.of((), ONE) if not leaf.text.isdigit()]
        if named and self.rng.random() < self.rash:
            rules += [
                lambda: Text(
                    f"{self.rng.choice(['sqrt', 'log', 'asin', 'acos', 'exp'])}({self._take(self.rng.choice(named))})"
                )
            ]
            rules += [
                lambda: Text(
                    f"{self._take(self.rng.choice(named))}^{self.rng.choice(['1.5', '-1', '-0.5'])}", 8
                )
            ]
        whole = (*self.scope.whole, *self.scope.picks, *(n for n, _, _ in self.scope.indices))
        rules += [
            lambda n=n: Text(
                self.rng.choice(["div({}, 2)", "mod({}, 2)", "mod({} + 1, 3)", "1/{}"]).format(n), 6
            )
            for n in whole[:2]
        ]
        return rules

    def _atan2(self, depth: int) -> Text:
        unit = self.rng.choice(COMMON)
        first = self._sum(self.make((), unit, depth), self.number(unit))  # hardly ever both are zero
        return Text(f"atan2({first}, {self.make((), unit, depth, loose=True)})")

    def _dot(self, unit: Unit, depth: int) -> Text:
        (a, b), size = self._split(unit), self.size()
        return Text(f"dot({self.make((size,), a, depth)}, {self.make((size,), b, depth)})")

    def _added_up(self, unit: Unit, depth: int) -> Text:
        name, size = self._index_name(), self.size()
        first = self.rng.choice(["1", "2"])
        item = self.within(self.scope.bind(name, first, size)).make((), unit, depth)
        return Text(f"sum([{item} for {name} in {first}..{size}])")

    # ---- vectors and matrices -------------------------------------------------------------------------------------------------------

    def _elementwise(self, shape: Shape, unit: Unit, depth: int) -> list[Callable[[], Text]]:
        def products() -> Text:
            a, b = self._split(unit)
            return Text(f"{self.make(shape, a, depth).at(6)} .* {self.make(shape, b, depth).at(7)}", 6)

        def quotients() -> Text:
            below = self.rng.choice(COMMON)
            return Text(
                f"{self.make(shape, times(unit, below), depth).at(6)} ./ {self._above_zero(shape, below, depth)}",
                6,
            )

        return [
            products,
            quotients,
            lambda: self._listed(shape, unit, depth),
            lambda: self._for(shape, unit, depth),
        ]

    def _above_zero(self, shape: Shape, unit: Unit, depth: int) -> Text:
        if not shape:
            return self.safe(unit, depth)
        name = self._index_name()
        return Text(
            f"[{self.within(self.scope.bind(name, '1', shape[0]))._above_zero(shape[1:], unit, depth)} for {name} in 1..{shape[0]}]"
        )

    def _listed(self, shape: Shape, unit: Unit, depth: int) -> Text:
        count = known(shape[0])
        if count is None:
            return self._for(shape, unit, depth)
        return Text(f"[{', '.join(str(self.make(shape[1:], unit, depth - 1)) for _ in range(count))}]")

    def _for(self, shape: Shape, unit: Unit, depth: int) -> Text:
        name = self._index_name()
        inner = self.within(self.scope.bind(name, "1", shape[0]))
        item = inner.make(shape[1:], unit, depth)
        if self.rng.random() < 0.3:
            test = f"{name} {self.rng.choice(['==', '<', '>='])} {self.rng.choice(['1', '2', shape[0]])}"
            item = Text(f"if {test} then {item} else {inner.make(shape[1:], unit, depth - 1)}", 0)
        return Text(f"[{item} for {name} in 1..{shape[0]}]")

    def _vector_rules(self, shape: Shape, unit: Unit, depth: int) -> list[Callable[[], Text]]:
        (size,) = shape
        rules = self._elementwise(shape, unit, depth)

        def applied() -> Text:
            (a, b), width = self._split(unit), self.size()
            return Text(
                f"{self.make((size, width), a, depth).at(6)}*{self.make((width,), b, depth).at(7)}", 6
            )

        rules += [applied, lambda: self._solved(shape, unit, depth)]
        if size == "3":
            rules.append(
                lambda: Text("cross({}, {})".format(*(self.make(shape, u, depth) for u in self._split(unit))))
            )
        return rules

    def _matrix_rules(self, shape: Shape, unit: Unit, depth: int) -> list[Callable[[], Text]]:
        rows, columns = shape
        rules = self._elementwise(shape, unit, depth)

        def product() -> Text:
            (a, b), width = self._split(unit), self.size()
            return Text(
                f"{self.make((rows, width), a, depth).at(6)}*{self.make((width, columns), b, depth).at(7)}", 6
            )

        rules += [product, lambda: Text(f"transpose({self.make((columns, rows), unit, depth)})")]
        rules.append(lambda: self._solved(shape, unit, depth))
        if rows == columns:
            rules.append(lambda: Text(f"{self.number(unit)}*eye({rows})", 6))
            if (known(rows) or 9) <= 3:
                rules.append(lambda: Text(f"inverse({self._regular(rows, over(ONE, unit), depth)})"))
        return rules

    def _regular(self, size: str, unit: Unit, depth: int) -> Text:
        """A square matrix that is hardly ever singular."""
        return Text(
            f"20*{self.number(unit)}*eye({size}) + {self.make((size, size), unit, depth - 1).at(6)}", 5
        )

    def _large(self, unit: Unit) -> Text:
        """Of the solution of a system that is factored at run time."""
        size, a = str(self.rng.choice([4, 4, 5, 6, 8, 12])), self.rng.choice(COMMON)
        if self.rng.random() < 0.3:
            return Text(f"trace(inverse({self._regular(size, over(ONE, unit), 1)}))")
        shape: Shape = (size, "2") if self.rng.random() < 0.2 else (size,)
        solution = f"solve({self._regular(size, a, 1)}, {self.make(shape, times(unit, a), 1)})"
        return Text(f"{'sum' if len(shape) == 2 else self.rng.choice(['sum', 'norm', 'max'])}({solution})")

    def _solved(self, shape: Shape, unit: Unit, depth: int) -> Text:
        if (known(shape[0]) or 9) > 3:
            return self._for(shape, unit, depth)
        a = self.rng.choice(COMMON)
        return Text(f"solve({self._regular(shape[0], a, depth)}, {self.make(shape, times(unit, a), depth)})")


def _fits(shape: Shape, wanted: Shape) -> bool:
    """Whether a function's value may be of the wanted shape."""
    sizes: dict[str, str] = {}
    return len(shape) == len(wanted) and all(
        (known(s) is None and sizes.setdefault(s, w) == w) or s == w
        for s, w in zip(shape, wanted, strict=True)
    )
