"""Structural parameters: those that reach a size, a range, an index or the choice of a coupling.

In: a `Library` with right names. Out: for each agent the names of its structural parameters. Their values are built into the model; all others
can change between runs. What settings and paths of an experiment use is structural too. A parameter is structural for all instances of its agent
alike, and so is every parameter it is computed from.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from hierc.compiler.resolve.declarations import Agent, Library, owner_of
from hierc.compiler.resolve.names import is_own, paths_of
from hierc.compiler.resolve.ordering import ordered, references
from hierc.compiler.walk import Visit, subscripts, visit
from hierc.grammar import tree

#: Functions whose arguments are sizes.
_SIZES = ("eye", "zeros")


def structural_parameters(library: Library) -> Mapping[str, frozenset[str]]:
    """Names of the structural parameters of each agent."""
    fixed_by = _fixed_function_parameters(library)
    inside, _ = ordered(
        {name: [s.instance.agent.text for s in a.subs.values()] for name, a in library.agents.items()}
    )
    found: dict[str, frozenset[str]] = {}
    for name in inside:
        agent = library.agents[name]
        names = set(_fixed_names(_expressions(agent), fixed_by))
        names.update(_type_names(agent))
        for sub in agent.subs.values():
            names.update(_choices(sub.instance, agent))
            inner = found[sub.instance.agent.text]
            index = sub.instance.index.index.text if sub.instance.index is not None else None
            fixed = [arg.value for arg in sub.instance.args if arg.name.text in inner]
            names.update(name for value in fixed for name in _names(value) if name != index)
        for experiment in library.experiments.values():
            if experiment.agent.text == name:
                names.update(_of_experiment(library, agent, experiment, found, fixed_by))
        found[name] = _closure(agent, names)
    return found


def _of_experiment(
    library: Library,
    agent: Agent,
    experiment: tree.Experiment,
    structural: Mapping[str, frozenset[str]],
    fixed_by: Mapping[str, frozenset[int]],
) -> Iterator[str]:
    """Names that an experiment of an agent needs when compiling: those in settings, in subscripts of paths, and in what structural parameters of
    agents inside are given.
    """
    inner = [arg for arg in experiment.args if not is_own(arg)]
    values = [arg.value for arg in inner] + [bind.value for bind in experiment.bindings]
    paths = [arg.path for arg in inner]
    fixed: list[tree.Expr] = []
    for item in experiment.items:
        paths += paths_of(item)
        match item:
            case tree.InitBlock(values=initials):
                values += [initial.value for initial in initials]
            case tree.Setting():
                fixed += _numbers((item,))
            case tree.GroupSettings(settings=settings):
                fixed += _numbers(settings)
            case _:
                pass
    for arg in inner:
        owner = owner_of(library, agent, arg.path)
        if owner is not None and arg.path.steps[-1].name.text in structural[owner.name]:
            fixed.append(arg.value)
    fixed += [sub for path in paths for step in path.steps for sub in subscripts(step.subs)]
    yield from _fixed_names(values, fixed_by)
    for value in fixed:
        yield from _names(value)


def _numbers(settings: Iterable[tree.Setting]) -> list[tree.Expr]:
    """The values of settings that are no words."""
    return [setting.value for setting in settings if setting.name.text != "method"]


def _names(expr: tree.Expr) -> list[str]:
    return [ref.path.steps[0].name.text for ref in references(expr)]


def _closure(agent: Agent, names: set[str]) -> frozenset[str]:
    """The parameters among `names`, and those that the `let`s and defaults among them are made of."""
    waiting = list(names)
    seen: set[str] = set()
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        if name in agent.lets:
            waiting += _names(agent.lets[name].let.value)
        elif name in agent.params:
            default = agent.params[name].default
            waiting += _names(default) if default is not None else []
    return frozenset(seen & agent.params.keys())


def _expressions(agent: Agent) -> Iterator[tree.Expr]:
    """All expressions of an agent but the sizes of its types."""
    for variable in agent.variables.values():
        yield from (e for e in (variable.declarator.initial, variable.declarator.nominal) if e is not None)
    yield from (let.let.value for let in agent.lets.values())
    yield from (param.default for param in agent.params.values() if param.default is not None)
    for equation in agent.equations:
        target, over = equation.equation.target, equation.over
        # As a target stands in a reference, its subscripts count as fixed.
        step = tree.Step(target.span, target.name, target.subs)
        place = tree.Ref(target.span, tree.Path(target.span, (step,)), False)
        yield from (_over(e, over) for e in (equation.equation.value, place))
    for sub in agent.subs.values():
        given = [arg.value for arg in sub.instance.args] + [bind.value for bind in sub.instance.bindings]
        yield from (_over(value, sub.instance.index) for value in given)
        if sub.instance.index is not None:
            yield _over(tree.Bool(sub.instance.index.span, True), sub.instance.index)
    yield from (invariant.condition for invariant in agent.invariants)


def _over(expr: tree.Expr, over: tree.Over | None) -> tree.Expr:
    """An expression in which the index of a `for` or of an array is bound; it may hide a parameter."""
    return expr if over is None else tree.Comprehension(over.span, expr, over)


def _type_names(agent: Agent) -> Iterator[str]:
    types = [p.type for p in agent.params.values()] + [v.decl.type for v in agent.variables.values()]
    for type_ in types:
        for size in subscripts(type_.sizes):
            yield from _names(size)


def _fixed_names(exprs: Iterable[tree.Expr], fixed_by: Mapping[str, frozenset[int]]) -> Iterator[str]:
    """Names in positions that must be known when compiling."""
    for expr in exprs:
        for here in visit(expr):
            if isinstance(here.node, tree.Ref) and here.fixed and _free(here):
                yield here.node.path.steps[0].name.text
            elif isinstance(here.node, tree.Call):
                name = here.node.function.text
                for place, arg in enumerate(here.node.args):
                    if name in _SIZES or place in fixed_by.get(name, ()):
                        yield from _names(arg)


def _free(here: Visit) -> bool:
    return isinstance(here.node, tree.Ref) and here.node.path.steps[0].name.text not in here.bound


def _choices(instance: tree.Instance, agent: Agent) -> Iterator[str]:
    """Names in conditions of couplings that are made of whole numbers and flags only: they choose what is coupled."""
    bound = frozenset({instance.index.index.text}) if instance.index is not None else frozenset[str]()
    for bind in instance.bindings:
        for here in visit(bind.value, bound):
            if isinstance(here.node, tree.Cond):
                used = [n for n in _names(here.node.condition) if n not in here.bound]
                timeless = not any(isinstance(v.node, tree.Time) for v in visit(here.node.condition))
                if timeless and all(n not in agent.subs and _is_whole(n, agent) for n in used):
                    yield from used


def _is_whole(name: str, agent: Agent) -> bool:
    param = agent.params.get(name)
    return (
        (param is not None and param.type.scalar != "real")
        or name in agent.consts
        or _is_of_file(name, agent)
    )


def _is_of_file(name: str, agent: Agent) -> bool:
    own = (agent.params, agent.consts, agent.variables, agent.lets, agent.subs)
    return not any(name in names for names in own)


def _fixed_function_parameters(library: Library) -> Mapping[str, frozenset[int]]:
    """For each function the places of the parameters that must be known when compiling."""
    calls = {
        name: [v.node.function.text for v in visit(func.body) if isinstance(v.node, tree.Call)]
        for name, func in library.funcs.items()
    }
    inside, _ = ordered(calls)
    found: dict[str, frozenset[int]] = {}
    for name in inside:
        func = library.funcs[name]
        names = set(_fixed_names([func.body], found)) | {n for size in func.type.sizes for n in _names(size)}
        found[name] = frozenset(place for place, param in enumerate(func.params) if param.name.text in names)
    return found
