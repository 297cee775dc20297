"""The meaning of a model, read off its syntax tree: a plain interpreter that shares nothing with the compiler but the parser.

Agents are objects that know the agent around them; a coupling is evaluated among the names of that agent; `x'` is the right-hand side of
`x`; functions are called. Everything is computed when it is asked for, element by element where elements could need each other, so nothing has
to be put in order first. Numbers are of any of numpy's types: with `longdouble` the interpreter has three digits more than what it judges.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import product
from typing import Any

import numpy as np

from hierc.grammar import tree
from plain import functions, outside, si
from plain.agents import Agent, Index, Scope, Shape
from plain.functions import Real, Value, as_real, plain


class Circular(Exception):
    """Values that need each other."""


class Interpreter:
    """A file's model: an experiment, or an agent on its own. `params` are values by path, in their declared units, those of arrays of agents in rows.

    `real` is the type of numbers.
    """

    def __init__(
        self, file: tree.File, run: str, params: Mapping[str, object] | None = None, real: Real = np.float64
    ) -> None:
        self.real, self.params = real, params or {}
        self.agents = {i.name.text: i for i in file.items if isinstance(i, tree.Agent)}
        self.consts = {i.name.text: i for i in file.items if isinstance(i, tree.Const)}
        self.funcs = {i.name.text: i for i in file.items if isinstance(i, tree.Func)}
        self.outside = {i.name.text: i for i in file.items if isinstance(i, tree.Table | tree.Extern)}
        experiments = {i.name.text: i for i in file.items if isinstance(i, tree.Experiment)}
        self.experiment = experiments.get(run)
        top = self.experiment.agent.text if self.experiment else run
        self._fixed: dict[object, Value] = {}
        self._known: dict[object, Value] = {}
        self.time, self.states = 0.0, None
        self.top = Agent(self, self.agents[top], None, None, None)

    # ---- what is asked for --------------------------------------------------------------------------------------------------------

    def set(self, time: float, states: Mapping[str, Any] | None) -> None:
        """The time, and values of all states by path; None: their initial values."""
        self._known = {}
        self.time, self.states = self.real(time), states

    def initial(self, time: float = 0.0) -> dict[str, Value]:
        """Initial values of all states, by path, in SI."""
        self.set(time, None)
        return {a.named(n): self._whole(a, n) for a, n in self._variables() if a.is_state(n)}

    def rates(self, time: float, states: Mapping[str, Any]) -> dict[str, Value]:
        """Derivatives of all states, by path, in SI."""
        self.set(time, states)
        return {a.named(n): self._whole(a, n, prime=True) for a, n in self._variables() if a.is_state(n)}

    def variables(self, time: float, states: Mapping[str, Any] | None) -> dict[str, Value]:
        """All variables, by path, in SI."""
        self.set(time, states)
        return {a.named(n): self._whole(a, n) for a, n in self._variables()}

    def nominals(self) -> dict[str, Value]:
        """The error scales of states that have one."""
        return {
            a.named(n): self.value(nominal, Scope(a))
            for a, n in self._variables()
            if (nominal := a.variables[n][1].nominal) is not None
        }

    def _variables(self) -> Iterator[tuple[Agent, str]]:
        for agent in self.top.inside():
            for name in agent.variables:
                yield agent, name

    def _whole(self, agent: Agent, name: str, *, prime: bool = False) -> Value:
        shape = agent.shape(name)
        return self._gathered(shape, lambda at: self._variable(agent, name, at, prime=prime))

    @staticmethod
    def _gathered(shape: Shape, element: Callable[[Index], Value]) -> Value:
        if not shape:
            return element(())
        places = list(np.ndindex(shape))
        values = np.array([element(at) for at in places]) if places else np.zeros(0, int)
        return values.reshape(shape)

    # ---- variables ----------------------------------------------------------------------------------------------------------------

    def _variable(self, agent: Agent, name: str, at: Index, *, prime: bool = False) -> Value:
        """One element of a variable or of its derivative."""

        def compute() -> Value:
            decl, declarator = agent.variables[name]
            if prime:
                equation = agent.equations["diff", name, at]
                return self.element(equation.value, equation.scope, equation.at)
            if decl.access == "read":
                return self.element(*self._coupling(agent, name), at)
            if declarator.initial is None:
                equation = agent.equations["alge", name, at]
                return self.element(equation.value, equation.scope, equation.at)
            if self.states is None:
                return self._start(agent, name, at)
            return np.asarray(self.states[agent.named(name)])[at]

        return self.real(self._once((agent, name, at, prime), self._known, compute))

    def _coupling(self, agent: Agent, name: str) -> tuple[tree.Expr, Scope]:
        of = agent.instance or self.experiment
        (value,) = (b.value for b in (of.bindings if of else ()) if b.name.text == name)
        return value, agent.around

    def _start(self, agent: Agent, name: str, at: Index) -> Value:
        """An element of an initial value."""
        given = [
            initial
            for item in (self.experiment.items if self.experiment else ())
            for initial in (item.values if isinstance(item, tree.InitBlock) else ())
        ]
        found = self._gift(given, agent, name, len(at))
        if found is not None:
            return found(at)
        initial = agent.variables[name][1].initial
        assert initial is not None
        return self.element(initial, Scope(agent), at)

    def _given(self, path: tree.Path, agent: Agent, name: str) -> tuple[int, Index] | None:
        """Whether an experiment's path names something in an agent: how many agents it means, and the place of this one among them, of each array of
        which it means several. Without a subscript it means all of an array.
        """
        steps = agent.steps
        if len(path.steps) != len(steps) + 1 or path.steps[-1].name.text != name:
            return None
        size, at, inside = 1, (), Scope(self.top)
        around = agent
        spans: list[range] = []
        while around.parent is not None and around.instance is not None:
            over = around.instance.index
            spans.insert(0, self.numbers(over.range, Scope(around.parent)) if over is not None else range(0))
            around = around.parent
        for step, (place, index), span in zip(path.steps[:-1], steps, spans, strict=True):
            if step.name.text != place:
                return None
            if index is None:
                continue
            if step.subs and not isinstance(step.subs[0], tree.Range):
                if int(self.value(step.subs[0], inside)) != index:
                    return None
                continue
            meant = self.numbers(step.subs[0], inside) if step.subs else span
            if index not in meant:
                return None
            size, at = size * len(meant), (*at, index - meant.start)
        return size, at

    def _gift(
        self, gifts: Iterable[tree.ExpArg | tree.Initial], agent: Agent, name: str, rank: int
    ) -> Callable[[Index], Value] | None:
        """What an experiment gives to something in an agent, element by element: the gift holds that means fewest agents."""
        found = [(g, meant) for g in gifts if (meant := self._given(g.path, agent, name)) is not None]
        if not found:
            return None
        gift, (_, at) = min(found, key=lambda pair: pair[1][0])
        own = isinstance(gift, tree.ExpArg) and not agent.steps
        value = self.value(gift.value, Scope(None if own else self.top))
        if np.ndim(value) == rank + len(at) and at:
            value = value[at]
        return lambda element: plain(np.asarray(value)[element]) if np.ndim(value) else value

    @staticmethod
    def _once(key: object, memory: dict[object, Value], compute: Callable[[], Value]) -> Value:
        if key not in memory:
            memory[key] = Circular
            try:
                memory[key] = compute()
            finally:
                if memory[key] is Circular:
                    del memory[key]
        if memory[key] is Circular:
            raise Circular(key)
        return memory[key]

    # ---- constants and parameters -------------------------------------------------------------------------------------------------

    def sizes(self, type_: tree.Type, scope: Scope) -> Shape:
        return tuple(int(self.value(size, scope)) for size in type_.sizes)

    def _typed(self, value: Value, type_: tree.Type) -> Value:
        if type_.scalar == "real":
            return as_real(value, self.real)
        return value if isinstance(value, bool | np.ndarray) else int(value)

    def _parameter(self, agent: Agent, name: str) -> Value:
        def compute() -> Value:
            param = agent.params[name]
            if (given := self._from_outside(agent, name)) is not None:
                scaled = given * si.declared(param.unit) if param.type.scalar == "real" else plain(given)
                return self._typed(scaled, param.type)
            shape = self.sizes(param.type, Scope(agent))
            gift = self._gift(self.experiment.args if self.experiment else (), agent, name, len(shape))
            if gift is not None:
                return self._typed(self._gathered(shape, gift), param.type)
            return self._typed(self.value(*self._argument(agent, param)), param.type)

        return self._once((agent, name), self._fixed, compute)

    def _from_outside(self, agent: Agent, name: str) -> Any:
        """What is given from outside: for one agent, or in rows for those of arrays, which are numbered from 1."""
        rank = len(agent.params[name].type.sizes)
        for path, value in self.params.items():
            *owners, last = re.findall(r"(\w+)(?:\[(\d+)\])?", path)
            if last[0] != name or [n for n, _ in owners] != [n for n, _ in agent.steps]:
                continue
            indices = [
                (sub, k) for (_, sub), (_, k) in zip(owners, agent.steps, strict=True) if k is not None
            ]
            if all(not sub or int(sub) == k for sub, k in indices):
                row = tuple(k - 1 for sub, k in indices if not sub)
                return np.asarray(value)[row if np.ndim(value) > rank else ()]
        return None

    def _argument(self, agent: Agent, param: tree.Param) -> tuple[tree.Expr, Scope]:
        """What gives a parameter its value where the experiment does not: the agent around, or the default."""
        for arg in agent.instance.args if agent.instance else ():
            if arg.name.text == param.name.text:
                return arg.value, agent.around
        assert param.default is not None
        return param.default, Scope(agent)

    # ---- expressions --------------------------------------------------------------------------------------------------------------

    def numbers(self, range_: tree.Range, scope: Scope) -> range:
        return range(int(self.value(range_.first, scope)), int(self.value(range_.last, scope)) + 1)

    def selected(
        self, shape: Shape, subs: tuple[tree.Expr | tree.Range, ...], scope: Scope
    ) -> Iterator[tuple[Index, Index]]:
        """The elements that subscripts choose: their places in the choice, and where they are."""
        if not subs:
            yield from ((at, at) for at in np.ndindex(shape))
            return
        choices: list[list[tuple[Index, int]]] = []
        for sub, size in zip(subs, shape, strict=True):
            if isinstance(sub, tree.Range):
                choice = [((n,), k - 1) for n, k in enumerate(self.numbers(sub, scope))]
            else:
                choice = [((), int(self.value(sub, scope)) - 1)]
            assert all(0 <= k < size for _, k in choice), "an index is outside"
            choices.append(choice)
        for places in product(*choices):
            yield sum((at for at, _ in places), ()), tuple(k for _, k in places)

    def value(self, expr: tree.Expr, scope: Scope) -> Value:
        """The value of an expression."""
        match expr:
            case tree.Number():
                return int(expr.value) if expr.is_int and expr.unit is None else self.real(si.literal(expr))
            case tree.Bool(value=value):
                return value
            case tree.Time():
                return self.time
            case tree.Ref():
                return self._reference(expr, scope)
            case tree.Call():
                return self._call(expr, scope)
            case tree.Unary(op=op, operand=operand):
                value = self.value(operand, scope)
                return not value if op == "not" else -value if op == "-" else value
            case tree.Binary(op="and", left=left, right=right):
                return self.value(left, scope) and self.value(right, scope)
            case tree.Binary(op="or", left=left, right=right):
                return self.value(left, scope) or self.value(right, scope)
            case tree.Binary(op=op, left=left, right=right):
                return functions.binary(op, self.value(left, scope), self.value(right, scope), self.real)
            case tree.Cond(condition=condition, then=then, other=other):
                return self.value(then if self.value(condition, scope) else other, scope)
            case tree.ListExpr(items=items):
                return np.array([self.value(item, scope) for item in items])
            case tree.Comprehension(item=item, over=over):
                numbers = self.numbers(over.range, scope)
                return np.array(
                    [self.value(item, scope.bind(over.index.text, k)) for k in numbers] or np.zeros(0, int)
                )

    def element(self, expr: tree.Expr, scope: Scope, at: Index) -> Value:
        """One element of the value of an expression, without the others where that is possible."""
        match expr:
            case _ if not at:
                return self.value(expr, scope)
            case tree.ListExpr(items=items):
                return self.element(items[at[0]], scope, at[1:])
            case tree.Comprehension(item=item, over=over):
                return self.element(
                    item, scope.bind(over.index.text, self.numbers(over.range, scope)[at[0]]), at[1:]
                )
            case tree.Cond(condition=condition, then=then, other=other):
                return self.element(then if self.value(condition, scope) else other, scope, at)
            case tree.Binary(op="+" | "-" | ".*" | "./" as op, left=left, right=right):
                return functions.binary(
                    op, self.element(left, scope, at), self.element(right, scope, at), self.real
                )
            case tree.Binary(op="*", left=left, right=right) if (
                np.ndim(factor := self.value(left, scope)) == 0
            ):
                return functions.binary("*", factor, self.element(right, scope, at), self.real)
            case tree.Binary(op="/", left=left, right=right):
                return functions.binary(
                    "/", self.element(left, scope, at), self.value(right, scope), self.real
                )
            case tree.Ref():
                _, found = self._chosen(expr, scope)
                return found(at)
            case _:
                return plain(self.value(expr, scope)[at])

    def _call(self, call: tree.Call, scope: Scope) -> Value:
        func = self.funcs.get(call.function.text)
        args = [self.value(arg, scope) for arg in call.args]
        match self.outside.get(call.function.text):
            case tree.Table() as item:
                return outside.table(item, args, self.real)
            case tree.Extern() as item:
                return outside.external(item, args, self.real)
        if func is None:
            return functions.call(call.function.text, args, self.real)
        inside = Scope()
        for param, arg in zip(func.params, args, strict=True):
            for size, actual in zip(param.type.sizes, np.shape(arg), strict=True):
                if isinstance(size, tree.Ref) and size.path.text not in self.consts:
                    inside = inside.bind(size.path.text, actual)
        for param, arg in zip(func.params, args, strict=True):
            inside = inside.bind(param.name.text, self._typed(arg, param.type))
        return self._typed(self.value(func.body, inside), func.type)

    # ---- names --------------------------------------------------------------------------------------------------------------------

    def _reference(self, ref: tree.Ref, scope: Scope) -> Value:
        shape, element = self._chosen(ref, scope)
        return self._gathered(shape, element) if shape is not None else element(())

    def _chosen(self, ref: tree.Ref, scope: Scope) -> tuple[Shape | None, Callable[[Index], Value]]:
        """The shape of what a reference names, and its elements; None: a value that is not looked at element by element."""
        *owners, last = ref.path.steps
        name, agent = last.name.text, scope.agent
        if owners:
            assert agent is not None
            return self._of_agents(agent, owners, last, scope, prime=ref.prime)
        if name not in scope.bound and agent is not None and name in agent.variables:
            return self._of_variable(agent, last, scope, prime=ref.prime)
        if name not in scope.bound and agent is not None and name in agent.lets and last.subs:
            let = agent.lets[name]
            if not any(isinstance(sub, tree.Range) for sub in last.subs):
                at = tuple(int(self.value(sub, scope)) - 1 for sub in last.subs)
                return None, lambda rest: self.element(let.value, Scope(agent), (*at, *rest))
        value = self._named(name, scope)
        places = dict(self.selected(np.shape(value), last.subs, scope))
        shape = tuple(max(column) + 1 for column in zip(*places, strict=True)) if places else (0,)
        return shape, lambda at: plain(np.asarray(value)[places[at]]) if np.ndim(value) else value

    def _named(self, name: str, scope: Scope) -> Value:
        """The value of a bound name, parameter, constant or `let`."""
        agent = scope.agent
        if name in scope.bound:
            return scope.bound[name]
        if agent is not None and name in agent.params:
            return self._parameter(agent, name)
        if agent is not None and name in agent.lets:
            let = agent.lets[name].value
            return self._once((agent, name), self._known, lambda: self.value(let, Scope(agent)))
        if agent is not None and name in agent.consts:
            const, outer = agent.consts[name], Scope(agent)
        elif name in self.consts:
            const, outer = self.consts[name], Scope()
        else:
            assert name == "pi", name
            return self.real(float(np.pi))
        return self._once(
            id(const), self._fixed, lambda: self._typed(self.value(const.value, outer), const.type)
        )

    def _of_variable(
        self, agent: Agent, step: tree.Step, scope: Scope, *, prime: bool
    ) -> tuple[Shape, Callable[[Index], Value]]:
        """A variable with its subscripts."""
        name = step.name.text
        shape = agent.shape(name)
        if step.subs:
            places = dict(self.selected(shape, step.subs, scope))
            ranges = [self.numbers(sub, scope) for sub in step.subs if isinstance(sub, tree.Range)]
            return tuple(len(r) for r in ranges), lambda at: self._variable(
                agent, name, places[at], prime=prime
            )
        return shape, lambda at: self._variable(agent, name, at, prime=prime)

    def _of_agents(
        self, agent: Agent, owners: list[tree.Step], last: tree.Step, scope: Scope, *, prime: bool
    ) -> tuple[Shape, Callable[[Index], Value]]:
        """A variable of a sub-agent, of one of an array, or of several."""
        (owner,) = owners
        child = agent.children[owner.name.text]
        if not isinstance(child, list):
            return self._of_variable(child, last, scope, prime=prime)
        numbers = {one.index: one for one in child}
        if not owner.subs:
            chosen = child
        elif isinstance(owner.subs[0], tree.Range):
            chosen = [numbers[k] for k in self.numbers(owner.subs[0], scope)]
        else:
            return self._of_variable(numbers[int(self.value(owner.subs[0], scope))], last, scope, prime=prime)
        if not chosen:
            return (0,), lambda _: None
        name = last.name.text
        shape = (len(chosen), *chosen[0].shape(name))
        places = dict(
            self.selected(shape, last.subs, scope)
        )  # subscripts of the variable are those of all together
        if last.subs:
            ranges = [self.numbers(sub, scope) for sub in last.subs if isinstance(sub, tree.Range)]
            shape = tuple(len(r) for r in ranges)
        return shape, lambda at: self._variable(chosen[places[at][0]], name, places[at][1:], prime=prime)
