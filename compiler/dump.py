"""What a phase made, as text: for reading, for golden tests, and for `hierc compile --emit`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass

from hierc.compiler.diagram import by_owner
from hierc.compiler.expression import Number
from hierc.compiler.formula import Formulas, number_text, parameter_names, source_name
from hierc.compiler.model import Model, Node, Settings
from hierc.grammar.source import SourceFile, Span


def dump_tree(value: object) -> str:
    """Any phase's data, one field a line; spans and files are left out."""
    top = value if isinstance(value, tuple) else (value,)
    label = "- " if isinstance(value, tuple) else ""
    return "\n".join(line for item in top for line in _tree(label, item, 0)) + "\n"


def _tree(label: str, value: object, depth: int) -> Iterator[str]:
    indent = "  " * depth
    if is_dataclass(value) and not isinstance(value, type):
        yield f"{indent}{label}{type(value).__name__}"
        for field in fields(value):
            content = getattr(value, field.name)
            if not isinstance(content, Span | SourceFile):
                yield from _tree(f"{field.name}: ", content, depth + 1)
    elif isinstance(value, Mapping) and value:
        yield f"{indent}{label.rstrip()}"
        for key, content in value.items():
            yield from _tree(f"{key!r}: ", content, depth + 1)
    elif isinstance(value, Sequence) and not isinstance(value, str) and any(_is_deep(item) for item in value):
        yield f"{indent}{label.rstrip()}"
        for item in value:
            yield from _tree("- ", item, depth + 1)
    else:
        yield f"{indent}{label}{value!r}"


def _is_deep(value: object) -> bool:
    if isinstance(value, Span | SourceFile):
        return False
    return is_dataclass(value) or (
        isinstance(value, Sequence) and not isinstance(value, str) and any(map(_is_deep, value))
    )


# ---- the model ----------------------------------------------------------------------------------------------------------------------


def dump_model(model: Model) -> str:
    """Parameters, equations of every node in execution order, groups and experiment."""
    names = parameter_names(model)
    lines = [_heading(model), "", "parameters"]
    whole = Formulas(model, _all_parameters(model), names)
    for parameter in model.parameters:
        unit = f" [{parameter.unit}]" if parameter.unit else ""
        values = ", ".join(whole.text(value) for value in parameter.values)
        value = f"[{values}]" if parameter.shape else values
        remarks = ("  (in SI)" if parameter.scale != 1.0 else "") + (
            "  (structural)" if parameter.structural else ""
        )
        lines.append(f"  {parameter.path}{unit} = {value}{remarks}")
    for node in model.nodes:
        lines += ["", *_node(Formulas(model, node, names), node)]
    lines += [
        "",
        "groups",
        *(f"  {g.name}: {', '.join(_path(model, n) for n in g.nodes)}" for g in model.groups),
    ]
    lines += ["", *_experiment(model)]
    return "\n".join(lines) + "\n"


def _heading(model: Model) -> str:
    return f"model {model.name} ({model.file})"


def _all_parameters(model: Model) -> Node:
    """A node that knows every parameter, to write the parameters' own values."""
    span = model.nodes[0].span if model.nodes else model.parameters[0].span
    return Node(-1, "", "", (), (), (), (), tuple(range(model.parameter_count)), span)


def _path(model: Model, node: int) -> str:
    return model.nodes[node].path or model.name


def _node(formulas: Formulas, node: Node) -> Iterator[str]:
    yield f"node {node.id}  {node.path or node.template}: {node.template}"
    for definition in node.definitions:
        yield f"  {definition.name} = {formulas.text(definition.value)}"
    for state in node.states:
        nominal = "" if state.nominal == Number(None, 1.0) else f", nominal {formulas.text(state.nominal)}"
        yield f"  {state.name}' = {formulas.text(state.rate)}   from {formulas.text(state.initial)}{nominal}"


def _experiment(model: Model) -> Iterator[str]:
    experiment = model.experiment
    yield f"experiment {experiment.name or '(none)'}"
    if settings := _settings(experiment.settings):
        yield f"  {settings}"
    for name, own in experiment.groups:
        yield f"  group {name}: {_settings(own)}"
    if experiment.record:
        yield f"  record {', '.join(experiment.record)}"
    if experiment.save:
        yield f"  save {', '.join(experiment.save)}"


def _settings(settings: Settings) -> str:
    given = ((field.name, getattr(settings, field.name)) for field in fields(settings))
    return ", ".join(
        f"{n} = {number_text(v) if isinstance(v, float) else v}" for n, v in given if v is not None
    )


# ---- the cascade --------------------------------------------------------------------------------------------------------------------


def dump_cascade(model: Model) -> str:
    """Groups from slow to fast, the agents in each, and what each reads of the others."""
    group_of = {node: group.name for group in model.groups for node in group.nodes}
    lines = [_heading(model)]
    for place, group in enumerate(model.groups, start=1):
        states = sum(len(model.nodes[n].states) for n in group.nodes)
        lines += ["", f"{place}. group {group.name}: {states} state{'s' * (states != 1)}"]
        for index in group.nodes:
            lines += _reads(model, model.nodes[index], group_of)
    without = [node for node in model.nodes if not node.states]
    if without:
        lines += ["", "without states, computed where they are read"]
        for node in without:
            lines += _reads(model, node, group_of)
    return "\n".join(lines) + "\n"


def _reads(model: Model, node: Node, group_of: Mapping[int, str]) -> Iterator[str]:
    yield f"   {node.path or model.name} ({node.template})"
    for owner, sources in by_owner(node.inputs).items():
        same = group_of.get(owner) == group_of.get(node.id)
        yield f"      {'uses ' if same else 'reads'} {', '.join(source_name(model, s) for s in sources)}"
