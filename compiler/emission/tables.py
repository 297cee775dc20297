"""Emission of tables: the constructor calls at the end of a generated module."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from hierc.compiler.arrays.columns import Index
from hierc.compiler.callees.callee import Extern, Table
from hierc.compiler.emission.callees import names_of
from hierc.compiler.emission.calls import Block, Group
from hierc.compiler.emission.names import function_name
from hierc.compiler.emission.packing import column, index, members
from hierc.compiler.emission.places import Found
from hierc.compiler.emission.plan import Plan, Variable
from hierc.compiler.emission.target import (
    Assign,
    Blank,
    Call,
    Constant,
    Dict,
    Name,
    Statement,
    Target,
    Tuple,
)
from hierc.compiler.model import Constants, Experiment, Parameter, Settings
from hierc.compiler.symbolic.defaults import Defaults
from hierc.compiler.symbolic.derive import Form

#: The function that completes the parameter vector.
DEFAULTS = "parameter_defaults"

SETTINGS = ("stop", "start", "rtol", "atol", "interval", "max_step", "min_step", "method")


def tables(
    plan: Plan, names: Sequence[str], defaults: Sequence[str], contract: int, release: str
) -> list[Statement]:
    """All tables and the model. `names` are the classes', `defaults` those of the functions that set defaults of blocks."""
    forms = plan.symbolic.forms
    classes = [_class(name, form, plan.source) for name, form in zip(names, forms, strict=True)]
    return [
        Blank(2),
        *_table("CLASSES", classes),
        *_table("NODES", map(_node, plan.nodes)),
        *_table("GROUP_TABLE", map(_group, plan.groups)),
        *_table("PARAMETER_TABLE", map(_parameter, plan.parameters)),
        *_table("VARIABLES", map(_variable, plan.variables)),
        *(_table("DEFAULTS", map(_defaults, defaults, plan.symbolic.block_defaults)) if defaults else ()),
        Assign(Name("EXPERIMENT"), _experiment(plan.experiment)),
        Blank(),
        Assign(Name("MODEL"), Call("Model", (_plan(plan, contract, release), Name("__file__")))),
        Blank(),
    ]


def _table(name: str, rows: Iterable[Target]) -> list[Statement]:
    return [Assign(Name(name), Tuple(tuple(rows))), Blank()]


def _numbers(numbers: Iterable[int]) -> Tuple:
    return Tuple(tuple(Constant(n) for n in numbers))


def _texts(texts: Iterable[str]) -> Tuple:
    return Tuple(tuple(Constant(t) for t in texts))


def _columns(columns: Iterable[Index]) -> Tuple:
    return Tuple(tuple(map(index, columns)))


def _found(places: Iterable[Found]) -> Tuple:
    return Tuple(tuple(Tuple((index(node), Constant(kind), index(at))) for node, kind, at in places))


def _several(count: int, indices: Sequence[Index]) -> tuple[tuple[str, Target], ...]:
    """The keywords of what has several elements."""
    counted = (("count", Constant(count)),) if count != 1 else ()
    return (*counted, ("indices", _columns(indices))) if indices else counted


def _class(name: str, form: Form, source: str) -> Call:
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
    if form.spans and form.spans[0].file.name != source:
        fields["file"] = Constant(form.spans[0].file.name)
    return Call("Class", keywords=tuple(fields.items()))


def _node(node: Block) -> Call:
    fields = (Constant(node.path), Constant(node.kind), _columns(node.parameters), _found(node.sources))
    return Call("Node", fields, _several(node.count, node.indices))


def _group(group: Group) -> Call:
    nodes = Tuple(tuple(map(members, group.nodes)))
    calls = Tuple(tuple(Tuple((members(entry), Constant(part))) for entry, part in group.calls))
    return Call("Group", (Constant(group.name), nodes, calls), _several(group.count, group.indices))


def _parameter(parameter: Parameter) -> Call:
    shape, first = _numbers(parameter.shape), Constant(parameter.first)
    rest = _given(
        unit=(parameter.unit, None),
        doc=(parameter.doc, ""),
        structural=(parameter.structural, False),
        kind=(parameter.scalar, "real"),
        scale=(parameter.scale, 1.0),
    )
    several = _several(parameter.count, parameter.indices)
    return Call("Parameter", (Constant(parameter.path), shape, first), rest + several)


def _variable(variable: Variable) -> Call:
    rest = _given(
        unit=(variable.unit, None),
        doc=(variable.doc, ""),
        access=(variable.access, "write"),
        scale=(variable.scale, 1.0),
    )
    fields = (Constant(variable.path), _numbers(variable.shape), _found(variable.elements))
    return Call("Variable", fields, rest + _several(variable.count, variable.indices))


def _defaults(function: str, defaults: Defaults) -> Call:
    given, entries = _columns(defaults.given), _columns(defaults.entries)
    return Call("Defaults", (Name(function), given, entries, Constant(defaults.count)))


def _constants(constants: Constants) -> Tuple:
    values = constants.values
    numbers = Tuple(tuple(map(Constant, values))) if isinstance(values, tuple) else column(values)
    return Tuple((Constant(constants.first), Constant(len(values)), numbers))


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
    if plan.constants:
        fields["constants"] = Tuple(tuple(map(_constants, plan.constants)))
    if plan.symbolic.block_defaults:
        fields["defaults"] = Name("DEFAULTS")
    if plan.order is not None:
        fields["order"] = index(plan.order)
    if plan.start_order is not None:
        fields["start_order"] = index(plan.start_order)
    return Call("Plan", keywords=tuple(fields.items()))
