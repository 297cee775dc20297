"""Alike: many terms of equal form, `a[1].x*b[1].x`, `a[2].x*b[2].x`, …, as one expression that nodes of their own compute, and the sum or extreme of them.

In: terms, scalar expressions that the elements of an agent, or of an array inside it, use. Out: a leaf that stands for all of them joined; None where they
are few, of many forms, not of other agents, or differ between elements that look at the same agent: then they are written out. Part of the
phase `flatten.py`.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hierc.compiler.arrays.columns import Integers, column, expanded
from hierc.compiler.arrays.domains import Domain, indexed_domain, inner_domain
from hierc.compiler.expression import Apply, Choose, Expr, Gather, Local, Number, Parameter, Rate, State
from hierc.compiler.shapes.operations import Reduction
from hierc.compiler.shapes.terms import MAX_DEPTH, rewritten
from hierc.compiler.shapes.values import index_value
from hierc.compiler.structure.array_reads import View
from hierc.compiler.structure.fan_in import FEW, FanIns
from hierc.compiler.structure.flat import Leaf, leaves
from hierc.compiler.structure.instances import Instance
from hierc.compiler.structure.sharing import Definitions
from hierc.compiler.structure.storage import Kind, StoredGathering
from hierc.grammar.source import Span

#: Most forms of the terms of one sum.
MAX_FORMS = 8


@dataclass(frozen=True, slots=True)
class Joiner:
    """Joins terms that the elements of `domain` use, which are in the agent `around`, whose names the terms have."""

    definitions: Definitions
    fan_ins: FanIns
    gathering: StoredGathering
    around: Instance
    domain: Domain

    def joined(self, operation: Reduction, terms: Sequence[Expr], span: Span) -> Expr | None:
        """A leaf that stands for the terms, joined."""
        forms = self._forms(terms) if len(terms) > FEW else None
        if forms is None:
            return None
        outer = self.around.domain
        seen, first, at = np.unique(self.domain.within(outer), return_index=True, return_inverse=True)
        around = (
            self.around
            if len(seen) == outer.count
            else replace(self.around, domain=inner_domain(outer, seen))
        )
        merger = _Merger(self.definitions, self.gathering, seen, first, at.ravel())
        parts: list[tuple[Expr, Domain]] = []
        for alike in forms:
            domain = indexed_domain(around.domain, np.arange(1, 1 + len(alike)))
            expr = merger.merged(alike, domain)
            if expr is None:
                return None
            parts.append((expr, domain))
        kind, numbers = self._numbers(parts, around, span)
        made = self.fan_ins.joined(operation, kind, numbers, around, span)
        return Gather(span, "algebraic", column(made[at.ravel()]))

    def _forms(self, terms: Sequence[Expr]) -> list[list[Expr]] | None:
        """The terms of each form, if there are few forms."""
        for _ in range(2):
            forms: dict[Hashable, list[Expr]] = {}
            for term in terms:
                forms.setdefault(_form(term), []).append(term)
            if None in forms:
                return None
            if len(forms) <= MAX_FORMS:
                return list(forms.values()) if sum(map(_is_of_others, terms)) > FEW else None
            terms = [self.definitions.unfolded(term) for term in terms]  # perhaps they were shared one by one
        return None

    def _numbers(
        self, parts: Sequence[tuple[Expr, Domain]], around: Instance, span: Span
    ) -> tuple[Kind, Integers]:
        """The terms as scalars, a row for each element of the agent."""
        rows = around.domain.count
        match parts:
            case [(Gather(kind="state" | "rate" | "algebraic" as kind, at=at), domain)]:
                return kind, expanded(at, domain.count).reshape(rows, -1)
        tables = []
        for expr, domain in parts:
            here = replace(around, domain=domain)
            made = self.fan_ins.computed(self.definitions.shallow(expr, "term", here), here, span)
            tables.append(made.reshape(rows, -1))
        return "algebraic", np.concatenate(tables, axis=1)


@dataclass(frozen=True, slots=True)
class _Merger:
    """Makes one expression of terms of equal form. `seen`: the places of the agent at which elements look; `first`: one element for each that does;
    `at`: for each element the place among `seen`.
    """

    definitions: Definitions
    gathering: StoredGathering
    seen: Integers
    first: Integers
    at: Integers

    def merged(self, terms: Sequence[Expr], domain: Domain) -> Expr | None:
        """The expression, for elements that are one for each place and term."""
        found: list[Expr] = []
        for position in zip(*map(leaves, terms), strict=True):
            leaf = self._leaf(position, domain)
            if leaf is None:
                return None
            found.append(leaf)
        following = iter(found)
        return rewritten(terms[0], lambda _: next(following))

    def _leaf(self, position: Sequence[Leaf], domain: Domain) -> Expr | None:
        """What stands at one position of all terms."""
        span = position[0].span
        numbers = [leaf.value for leaf in position if isinstance(leaf, Number)]
        if len(numbers) == len(position):
            if len(set(numbers)) == 1:
                return position[0]
            entries = self.gathering.table(tuple(numbers)) + np.arange(len(numbers))
            return Gather(span, "parameter", column(np.tile(entries, len(self.seen))))
        gathers = [g for leaf in position if isinstance(g := self.gathering.leaf(leaf), Gather)]
        if len(gathers) < len(position):
            return self._same(position[0], domain)
        table = np.stack([expanded(g.at, len(self.at)) for g in gathers])
        own = table[:, self.first]
        if (own[:, self.at] != table).any():
            return None
        at = column(own.T.ravel())
        return index_value(at, span) if gathers[0].kind == "index" else Gather(span, gathers[0].kind, at)

    def _same(self, leaf: Leaf, domain: Domain) -> Expr | None:
        """A leaf that all terms have, `time` or a definition that is no variable."""
        if isinstance(leaf, Local):
            count = self.definitions.made[leaf.index].domain.count
            if count > 1 and len(self.seen) < len(self.at):
                return None  # of the elements that look, which are several for each of the agent
        return self.definitions.brought_to(View(domain, self.seen[domain.places], ""), leaf)


def _is_of_others(term: Expr) -> bool:
    """Whether a term reads agents of an array."""
    return any(
        isinstance(leaf, Gather) and leaf.kind in ("state", "rate", "algebraic") for leaf in leaves(term)
    )


def _form(term: Expr) -> Hashable:
    """What terms of equal form have in common: operations, and what their leaves are; None for a deep one."""
    form: list[Hashable] = []
    stack = [(term, 0)]
    while stack:
        here, depth = stack.pop()
        parts: Sequence[Expr] = ()
        match here:
            case Apply(op=op, args=args, callee=callee):
                literal = args[0] if op == "solve" else None  # the number of the unknown is no value
                form += [op, len(args), id(callee), literal]
                parts = args
            case Choose(condition=condition, then=then, other=other):
                form.append("if")
                parts = (condition, then, other)
            case Gather(kind=kind):
                form.append(kind)
            case Number():
                form.append("number")
            case State() | Rate() | Parameter():
                form.append(type(here).__name__)
            case _:
                form.append(here)
        if depth >= MAX_DEPTH:
            return None
        stack += [(part, depth + 1) for part in reversed(parts)]
    return tuple(form)
