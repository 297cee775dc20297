"""What a function of a generated module depends on, and its split into a part of inputs and time and a part of states.

An implicit step evaluates a right-hand side at the same times again and again while only the states change. Whatever does not depend on the states is
computed once a step: `split` moves those statements into a function of their own, which leaves the values that the rest needs in an array `v`. Factors
of a matrix take several entries of it. `narrowed` leaves out of a function what some of its results do not need.

Every statement is looked at once (`_facts`), and what follows from that goes from name to name, so all of this takes time in proportion to the text.
"""

from __future__ import annotations

import ast
import functools
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass

from hierc.runtime.linalg import factor_size

#: Functions of `math` that jump.
_STEPS = frozenset({"floor", "ceil", "copysign", "fmod"})
#: Says of a subscript (array, index) whether it is fixed, that is does not depend on the states.
Fixed = Callable[[str, int], bool]


@dataclass(frozen=True, slots=True)
class Split:
    """`before` computes what is fixed and fills `v[0..saved)`; `after` does the rest. Together they do what the whole function does."""

    before: ast.FunctionDef
    after: ast.FunctionDef
    saved: int


def split(function: ast.FunctionDef, output: str, fixed: Fixed, *, telling: bool = False) -> Split:
    """Split `function(…, output)`. The new functions take a last argument `v`; `before` has no `output`, unless it is `telling` what of it is
    fixed.
    """
    moving = _moving(function, fixed)
    before: list[ast.stmt] = []
    after: list[ast.stmt] = []
    saved = 0
    for k, statement in enumerate(function.body):
        if k in moving:
            after.append(statement)
        elif isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Subscript):
            before.append(_assign(_item("v", saved, context=ast.Store()), statement.value))
            after.append(_assign(statement.targets[0], _item("v", saved)))
            if telling:
                before.append(after[-1])
            saved += 1
        else:
            before.append(statement)
    needed = _names_read(after)
    prologue: list[ast.stmt] = []
    sizes = _sizes(before)
    for name in [n for n in dict.fromkeys(_names_assigned(before)) if n in needed]:
        size = sizes.get(name)
        before.append(_assign(_item("v", saved, size, ast.Store()), ast.Name(name, ast.Load())))
        prologue.append(_assign(ast.Name(name, ast.Store()), _item("v", saved, size)))
        saved += size or 1
    arguments = [a.arg for a in function.args.args]
    return Split(
        _function(
            f"{function.name}_before", [*(a for a in arguments if telling or a != output), "v"], before
        ),
        _function(f"{function.name}_after", [*arguments, "v"], prologue + after),
        saved,
    )


def depends(function: ast.FunctionDef, output: str, fixed: Fixed) -> set[int]:
    """Indices of `output` whose values are not fixed."""
    facts = _facts(function)
    return {entry for k in _moving(function, fixed) for array, entry in facts[k].stored if array == output}


def narrowed(function: ast.FunctionDef, output: str, entries: Collection[int]) -> ast.FunctionDef:
    """The function without what these entries of its output do not need; others need not be set."""
    needed: set[str] = set()
    kept: list[ast.stmt] = []
    wanted = {(output, k) for k in entries}
    for statement, facts in zip(reversed(function.body), reversed(_facts(function)), strict=True):
        if not (facts.stored.isdisjoint(wanted) and facts.assigned.isdisjoint(needed)):
            kept.append(statement)
            needed |= facts.names
    return _function(function.name, [a.arg for a in function.args.args], kept[::-1])


def switches(function: ast.FunctionDef) -> bool:
    """Whether a function has branches or steps, or may have them in what it calls: its derivatives then do not tell how it moves."""
    return any(
        isinstance(node, ast.If | ast.IfExp)
        or (isinstance(node, ast.Attribute) and node.attr in _STEPS)
        or (isinstance(node, ast.Call) and isinstance(node.func, ast.Name))
        for node in ast.walk(function)
    )


@dataclass(frozen=True, slots=True)
class _Facts:
    """Of one statement: all names in it and those that it sets, and the entries of arrays that it reads and stores."""

    names: frozenset[str]
    assigned: frozenset[str]
    read: frozenset[tuple[str, int]]
    stored: frozenset[tuple[str, int]]
    branches: bool


@functools.lru_cache(maxsize=64)
def _facts(function: ast.FunctionDef) -> tuple[_Facts, ...]:
    """Of each statement of a function. Trees are known by their identity, and are never changed."""
    return tuple(_facts_of(statement) for statement in function.body)


def _facts_of(statement: ast.stmt) -> _Facts:
    names: set[str] = set()
    assigned: set[str] = set()
    read: set[tuple[str, int]] = set()
    stored: set[tuple[str, int]] = set()
    stack: list[ast.AST] = [statement]
    while stack:
        match node := stack.pop():
            case ast.Name(id=name, ctx=context):
                names.add(name)
                if isinstance(context, ast.Store):
                    assigned.add(name)
            case ast.Subscript(value=ast.Name(id=array), ctx=context):
                (stored if isinstance(context, ast.Store) else read).add((array, _index(node)))
            case ast.BinOp(left=left, right=right):
                stack += (left, right)
            case _:
                stack += ast.iter_child_nodes(node)
    return _Facts(
        frozenset(names),
        frozenset(assigned),
        frozenset(read),
        frozenset(stored),
        isinstance(statement, ast.If),
    )


def _moving(function: ast.FunctionDef, fixed: Fixed) -> set[int]:
    """The numbers of the statements that are not fixed: what reads something that is not, and whatever has to do with a name that one of them sets."""
    facts = _facts(function)
    users: dict[str, list[int]] = {}
    for k, fact in enumerate(facts):
        for name in fact.names:
            users.setdefault(name, []).append(k)
    stack = [k for k, fact in enumerate(facts) if _begins_to_move(fact, fixed)]
    moving = set(stack)
    while stack:
        for name in facts[stack.pop()].assigned:
            new = [k for k in users.pop(name, ()) if k not in moving]
            moving.update(new)
            stack += new
    return moving


def _begins_to_move(fact: _Facts, fixed: Fixed) -> bool:
    if fact.branches and fact.stored:
        return True  # stores within a branch stay together with it
    return ("t" in fact.names and not fixed("t", 0)) or not all(fixed(*item) for item in fact.read)


def targets(statement: ast.stmt) -> Iterable[ast.expr]:
    """All assignment targets in a statement, those of its branches included."""
    for node in ast.walk(statement):
        if isinstance(node, ast.Assign):
            for target in node.targets:
                yield from target.elts if isinstance(target, ast.Tuple) else [target]


def _sizes(statements: list[ast.stmt]) -> dict[str, int]:
    """How many doubles each name takes that holds the factors of a matrix."""
    found: dict[str, int] = {}
    for node in (n for s in statements for n in ast.walk(s)):
        match node:
            case ast.Assign(
                targets=[ast.Name(id=name)],
                value=ast.Call(func=ast.Attribute(attr="factor"), args=[ast.Constant(value=int(n)), *_]),
            ):
                found[name] = factor_size(n)
    return found


def _names_assigned(statements: list[ast.stmt]) -> list[str]:
    return [t.id for s in statements for t in targets(s) if isinstance(t, ast.Name)]


def _names_read(statements: list[ast.stmt]) -> set[str]:
    return {
        n.id
        for s in statements
        for n in ast.walk(s)
        if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)
    }


def _index(node: ast.Subscript) -> int:
    """The entry that a subscript names; of a slice the first: the entries of factors depend on the same."""
    index = node.slice.lower if isinstance(node.slice, ast.Slice) else node.slice
    assert isinstance(index, ast.Constant)
    assert isinstance(index.value, int)
    return index.value


def _item(
    array: str, first: int, size: int | None = None, context: ast.expr_context | None = None
) -> ast.Subscript:
    """Entry `first` of an array, or `size` entries from there."""
    place: ast.expr = ast.Constant(first)
    if size is not None:
        place = ast.Slice(place, ast.Constant(first + size))
    return ast.Subscript(ast.Name(array, ast.Load()), place, context or ast.Load())


def _assign(target: ast.expr, value: ast.expr) -> ast.Assign:
    return ast.copy_location(ast.Assign([target], value), value)


def _function(name: str, arguments: list[str], body: list[ast.stmt]) -> ast.FunctionDef:
    signature = ast.arguments([], [ast.arg(a) for a in arguments], None, [], [], None, [])
    made = ast.FunctionDef(name, signature, body or [ast.Pass()], [])
    return ast.fix_missing_locations(made)
