"""Emission of tables: the constructor calls at the end of a generated module, and the public face on import."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence

from hierc.compiler.callees.callee import Extern, Table
from hierc.compiler.emission.callees import names_of
from hierc.compiler.emission.names import function_name
from hierc.compiler.emission.plan import Group, Node, Plan, Variable
from hierc.compiler.emission.target import (
    Assign,
    Blank,
    Call,
    Constant,
    Dict,
    Function,
    Name,
    Return,
    Statement,
    Target,
    Tuple,
)
from hierc.compiler.model import Experiment, Parameter, Settings
from hierc.compiler.symbolic.derive import Form

#: The function that completes the parameter vector.
DEFAULTS = "parameter_defaults"

SETTINGS = ("stop", "start", "rtol", "atol", "interval", "max_step", "min_step", "method")


def tables(plan: Plan, names: Sequence[str], contract: int, release: str) -> list[Statement]:
    """All tables, the model, and what a user calls."""
    forms = plan.symbolic.forms
    classes = [_class(name, form) for name, form in zip(names, forms, strict=True)]
    return [
        Blank(2),
        *_table("CLASSES", classes),
        *_table("NODES", map(_node, plan.nodes)),
        *_table("GROUP_TABLE", map(_group, plan.groups)),
        *_table("PARAMETER_TABLE", map(_parameter, plan.parameters)),
        *_table("VARIABLES", map(_variable, plan.variables)),
        Assign(Name("EXPERIMENT"), _experiment(plan.experiment)),
        Blank(),
        Assign(Name("MODEL"), Call("Model", (_plan(plan, contract, release), Name("__file__")))),
        Blank(),
        *_face(plan),
    ]


def _table(name: str, rows: Iterable[Target]) -> list[Statement]:
    return [Assign(Name(name), Tuple(tuple(rows))), Blank()]


def _numbers(numbers: Iterable[int]) -> Tuple:
    return Tuple(tuple(Constant(n) for n in numbers))


def _texts(texts: Iterable[str]) -> Tuple:
    return Tuple(tuple(Constant(t) for t in texts))


def _found(places: Iterable[tuple[int, str, int]]) -> Tuple:
    return Tuple(
        tuple(Tuple((Constant(node), Constant(kind), Constant(index))) for node, kind, index in places)
    )


def _class(name: str, form: Form) -> Call:
    def function(role: str) -> Name:
        return Name(function_name(name, role))

    parts = tuple(
        Call("Part", (function(f"out{k}"), _numbers(part.outs), _numbers(part.inputs)))
        for k, part in enumerate(form.parts)
    )
    fields: dict[str, Target] = {
        "name": Constant(form.template),
        "states": _texts(form.states),
        "inputs": Constant(form.inputs),
        "parameters": Constant(form.parameters),
        "values": Constant(form.values),
        "outs": Constant(len(form.outs)),
        "observed": Constant(form.observed),
        "rhs": function("rhs"),
        "parts": Tuple(parts),
        "observe": function("observe") if form.observe else Constant(None),
        "jac": function("jac"),
        "pattern": Tuple(tuple(_numbers(entry) for entry in form.pattern)),
        "start": function("start"),
        "fill": function("values"),
        "nominal": function("nominal"),
        "flops": Constant(form.flops),
        "lines": _numbers(span.line for span in form.spans),
    }
    return Call("Class", keywords=tuple(fields.items()))


def _node(node: Node) -> Call:
    return Call(
        "Node", (Constant(node.path), Constant(node.kind), _numbers(node.parameters), _found(node.sources))
    )


def _group(group: Group) -> Call:
    calls = Tuple(tuple(_numbers(call) for call in group.calls))
    return Call("Group", (Constant(group.name), _numbers(group.nodes), calls))


def _parameter(parameter: Parameter) -> Call:
    shape, first = _numbers(parameter.shape), Constant(parameter.first)
    rest = _given(
        unit=(parameter.unit, None),
        doc=(parameter.doc, ""),
        structural=(parameter.structural, False),
        kind=(parameter.scalar, "real"),
        scale=(parameter.scale, 1.0),
    )
    return Call("Parameter", (Constant(parameter.path), shape, first), rest)


def _variable(variable: Variable) -> Call:
    rest = _given(
        unit=(variable.unit, None),
        doc=(variable.doc, ""),
        access=(variable.access, "write"),
        scale=(variable.scale, 1.0),
    )
    return Call(
        "Variable", (Constant(variable.path), _numbers(variable.shape), _found(variable.elements)), rest
    )


def _given(
    **fields: tuple[str | bool | float | None, str | bool | float | None],
) -> tuple[tuple[str, Target], ...]:
    """The keywords whose value is not the default; each field is (value, default)."""
    return tuple((name, Constant(value)) for name, (value, default) in fields.items() if value != default)


def _experiment(experiment: Experiment) -> Call:
    fields: dict[str, Target] = {
        "name": Constant(experiment.name),
        "settings": _settings(experiment.settings),
        "groups": Dict(tuple((group, _settings(settings)) for group, settings in experiment.groups)),
        "record": _texts(experiment.record),
        "save": _texts(experiment.save),
    }
    return Call("Experiment", keywords=tuple(fields.items()))


def _settings(settings: Settings) -> Dict:
    given: Mapping[str, float | str | None] = {name: getattr(settings, name) for name in SETTINGS}
    return Dict(tuple((name, Constant(value)) for name, value in given.items() if value is not None))


def _plan(plan: Plan, contract: int, release: str) -> Call:
    fields: dict[str, Target] = {
        "contract": Constant(contract),
        "hierc": Constant(release),
        "name": Constant(plan.name),
        "doc": Constant(plan.doc),
        "source": Constant(plan.source),
        "digest": Constant(plan.digest),
        "classes": Name("CLASSES"),
        "nodes": Name("NODES"),
        "groups": Name("GROUP_TABLE"),
        "parameters": Name("PARAMETER_TABLE"),
        "parameter_count": Constant(plan.parameter_count),
        "parameters_function": Name(DEFAULTS),
        "variables": Name("VARIABLES"),
        "start_passes": Constant(plan.start_passes),
        "experiment": Name("EXPERIMENT"),
    }
    if called := plan.symbolic.called:
        fields |= {"tables": names_of(called, Table), "externs": names_of(called, Extern)}
    return Call("Plan", keywords=tuple(fields.items()))


# ---- the public face ------------------------------------------------------------------------

_SIMULATE = """Simulates the model; what is not given is as in its experiment.

stop      end time [s]
rtol      relative tolerance
atol      absolute tolerance, times each state's nominal value
params    parameters by path (PARAMETERS) in their declared units, replacing their defaults
settings  start, interval, max_step, min_step, method

Returns a `hierc.runtime.result.Result`.
"""

_RHS = """The derivatives of all states, shape ({states},), at time t [s], for scipy.integrate.solve_ivp and the like.

x       states, shape ({states},), in the order of STATES, in SI units
params  parameters by path (PARAMETERS) in their declared units, replacing their defaults

NaN where an equation is not defined."""

_JACOBIAN = (
    """The derivatives of `rhs` by the states, shape ({states}, {states}), exact; arguments as for `rhs`."""
)

#: Names that a docstring lists; beyond that the constants have them all.
LISTED = 40


def _face(plan: Plan) -> list[Statement]:
    states = [
        f"{plan.nodes[n].path}.{name}" if plan.nodes[n].path else name
        for group in plan.groups  # the order of state vectors
        for n in group.nodes
        for name in plan.symbolic.forms[plan.nodes[n].kind].states
    ]
    names = {
        "PARAMETERS": [p.path for p in plan.parameters],
        "STATES": states,
        "GROUPS": [g.name for g in plan.groups],
    }
    simulate = "\n".join([_SIMULATE, *(_listing(title, listed) for title, listed in names.items())])
    count = len(states)
    return [
        *(Assign(Name(name), _texts(listed)) for name, listed in names.items()),
        *_method("simulate", ("stop", "rtol", "atol", "params"), 0, simulate, rest="settings"),
        *_method("rhs", ("t", "x", "params"), 2, _RHS.format(states=count)),
        *_method("jacobian", ("t", "x", "params"), 2, _JACOBIAN.format(states=count)),
    ]


def _listing(title: str, names: Sequence[str]) -> str:
    shown = ", ".join(names[:LISTED]) or "none"
    more = f", and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return textwrap.fill(
        f"{title.capitalize()}: {shown}{more}", 100, subsequent_indent="    ", break_on_hyphens=False
    )


def _method(name: str, arguments: Sequence[str], required: int, doc: str, rest: str = "") -> list[Statement]:
    """A function that calls the model's method of the same name."""
    parameters = [a if k < required else f"{a}=None" for k, a in enumerate(arguments)]
    if rest:
        parameters.append(f"**{rest}")
    call = Call(f"MODEL.{name}", tuple(Name(a) for a in arguments), rest=rest)
    return [Blank(2), Function(name, tuple(parameters), doc, (Return(call),))]
