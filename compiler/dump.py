"""What a phase made, as text: for reading, for golden tests, and for `hierc compile --emit`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass

import numpy as np

from hierc.compiler.arrays.columns import Integers, expanded, taken
from hierc.compiler.arrays.elements import Elements, spelled
from hierc.compiler.expression import Number
from hierc.compiler.formula import Formulas, Names, number_text
from hierc.compiler.model import Group, Model, Node, Settings, Source
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
    names = Names(model)
    lines = [_heading(model), "", "parameters"]
    whole = Formulas(names)
    for parameter in model.parameters:
        unit = f" [{parameter.unit}]" if parameter.unit else ""
        values = ", ".join(whole.text(value) for value in parameter.values)
        value = f"[{values}]" if parameter.shape else values
        remarks = ("  (in SI)" if parameter.scale != 1.0 else "") + (
            "  (structural)" if parameter.structural else ""
        )
        path = spelled(parameter.path, parameter.indices)
        lines.append(f"  {path}{unit} = {value}{remarks}")
    for node in model.nodes:
        lines += ["", *_node(Formulas(names, node), node)]
    lines += [
        "",
        "groups",
        *(f"  {_name(g)}: {', '.join(path for path, _, _ in _inside(model, g))}" for g in model.groups),
    ]
    lines += ["", *_experiment(model)]
    return "\n".join(lines) + "\n"


def _heading(model: Model) -> str:
    return f"model {model.name} ({model.file})"


def _name(group: Group) -> str:
    """A group, or a family of groups."""
    several = f" ({group.count} groups)" if group.count > 1 else ""
    return spelled(group.name, group.indices) + several


def _inside(model: Model, group: Group) -> Iterator[tuple[str, Node, Integers]]:
    """What is in a group or in all groups of a family: names, and the elements' places in their blocks."""
    elements = Elements(node.first for node in model.nodes)
    for column in group.nodes:
        numbers = expanded(column, 1)
        blocks = elements.blocks(numbers)
        for block in dict.fromkeys(blocks.tolist()):
            node = model.nodes[block]
            places = numbers[blocks == block] - node.first
            yield _path(model, node, places), node, places


def _path(model: Model, node: Node, places: Integers) -> str:
    return spelled(node.path, [taken(index, places) for index in node.indices]) or model.name


def _node(formulas: Formulas, node: Node) -> Iterator[str]:
    yield f"node {node.id}  {spelled(node.path, node.indices) or node.template}: {node.template}"
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
    names, homes = Names(model), _homes(model)
    lines = [_heading(model)]
    for place, group in enumerate(model.groups, start=1):
        inside = list(_inside(model, group))
        states = sum(len(node.states) * len(places) for _, node, places in inside) // group.count
        each = " each" if group.count > 1 else ""
        lines += ["", f"{place}. group {_name(group)}: {states} state{'s' * (states != 1)}{each}"]
        for path, node, places in inside:
            lines += _reads(names, node, path, places, homes)
    without = [node for node in model.nodes if not node.states]
    if without:
        lines += ["", "without states, computed where they are read"]
        for node in without:
            places = np.arange(node.count)
            lines += _reads(names, node, _path(model, node, places), places, homes)
    return "\n".join(lines) + "\n"


def _homes(model: Model) -> Integers:
    """The group of each element, numbered through; -1 without one."""
    homes = np.full(sum(node.count for node in model.nodes), -1)
    first = 0
    for group in model.groups:
        for column in group.nodes:
            numbers = expanded(column, 1)
            homes[numbers] = first + np.arange(len(numbers)) // (len(numbers) // group.count)
        first += group.count
    return homes


def _reads(names: Names, node: Node, path: str, places: Integers, homes: Integers) -> Iterator[str]:
    """What elements at some places of a block read: a line for each node, and whether it is in their group."""
    yield f"   {path} ({node.template})"
    lines: dict[tuple[str, bool], list[str]] = {}
    for source in node.inputs:
        read = Source(taken(source.node, places), source.kind, taken(source.index, places))
        same = bool((homes[expanded(read.node, len(places))] == homes[node.first + places]).all())
        name = names.source(read, len(places))
        lines.setdefault((name.rpartition(".")[0], same), []).append(name)
    for (_, same), read_names in lines.items():
        yield f"      {'uses ' if same else 'reads'} {', '.join(read_names)}"
