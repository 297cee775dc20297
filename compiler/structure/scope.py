"""Scopes of agents whose variables have their places: what a name of an agent is, for the agent itself and for the elements of an array inside it.

Part of the phase `flatten.py`; arrays of agents are in `array_reads.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from hierc.compiler.arrays.errors import NotAnArray
from hierc.compiler.collector import Rejected
from hierc.compiler.expression import Rate, State
from hierc.compiler.resolve.declarations import Variable
from hierc.compiler.shapes.environment import Axis, Chosen, Environment
from hierc.compiler.shapes.values import Value
from hierc.compiler.structure.array_reads import Owner, Reader, View
from hierc.compiler.structure.instances import Instance
from hierc.compiler.structure.reductions import Reductions
from hierc.grammar import tree


@dataclass(frozen=True, slots=True)
class InstanceScope:
    """The names of one agent: its parameters and constants, its variables and `let`s, the `write` variables of its sub-agents.

    `view`: whose elements see it; None for the agent itself.
    """

    owner: Owner
    instance: Instance
    view: View | None = None

    def lookup(self, ref: tree.Ref, chosen: Chosen | None) -> Value:
        """The value of a reference, without its last subscripts. Raises Rejected for what has none."""
        steps = ref.path.steps
        at, name = self.instance, steps[0].name.text
        if len(steps) > 1:
            if name in at.arrays:
                return self._reader.elements(ref, at.arrays[name], chosen)
            if chosen is not None:
                raise Rejected(NotAnArray(chosen.step.span, name=name, arrays=tuple(at.arrays)))
            if name not in at.children:
                raise Rejected  # it was refused
            at, name = self.owner.instance(at.children[name]), steps[1].name.text
        value = self._of(ref, at, name)
        return value if self.view is None else self.owner.brought(value, self.view)

    def _of(self, ref: tree.Ref, at: Instance, name: str) -> Value:
        """A name of a single agent."""
        variable = at.agent.variables.get(name)
        if ref.prime:
            return self._rate(ref, at, name, variable)
        if variable is not None and variable.decl.access != "read":
            return self.owner.storage.value(at, name, ref.span)
        named = self.owner.named_of(at, name)
        if named is not None:
            return self.owner.placed(named, ref.span)
        value = (
            self.owner.parameters_of(at).by_name.get(name)
            if name not in at.agent.lets and variable is None
            else None
        )
        if value is None:
            raise Rejected
        return value.at(ref.span)

    def _rate(self, ref: tree.Ref, at: Instance, name: str, variable: Variable | None) -> Value:
        self._reader.check_rate(ref, at, name, variable)
        value = self.owner.storage.value(at, name, ref.span)
        return replace(
            value, elements=tuple(Rate(ref.span, e.index) for e in value.elements if isinstance(e, State))
        )

    def reduced(
        self, call: tree.Call, ref: tree.Ref, agents: Axis | None, axes: Sequence[Axis]
    ) -> Value | None:
        """See `evaluate.Scope`. Elements of an array that look at the same agent around them share what it makes."""
        return Reductions(self._reader).of_variable(call, ref, agents, axes)

    def reduced_over(
        self, call: tree.Call, comprehension: tree.Comprehension, indices: Axis, env: Environment
    ) -> Value | None:
        """See `evaluate.Scope`."""
        return Reductions(self._reader).of_expression(call, comprehension, indices, env)

    @property
    def _reader(self) -> Reader:
        return Reader(self.owner, self.instance, self.view)
