"""The front half of the compiler: from a syntax tree to the structured model.

It only calls the phases one after the other; each states its contract in its own module:

    modules       the files of the model                instances    the tree of agents
    declarations  what is declared, by name             parameters   the parameter vector
    views         what each file sees of others         flatten      scalar equations, couplings substituted
    names         every name is right                   loops        nothing needs itself
    definitions   one for each variable                 nodes        each node in its own indices
    linking       one library of all files              proof        no level depends on a later one
    checks        units are known and agree             grouping     subsystems and their order
    structural    which parameters are built in         experiments  which agent runs; settings and records
    constants     values of constants

A phase collects all problems it can find; the first phase with errors is the last one to run.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from hierc.compiler.arrays.columns import Column, column, column_of, mapped
from hierc.compiler.callees.externs import make_externs
from hierc.compiler.callees.tables import read_tables
from hierc.compiler.cascade.grouping import Family, make_groups
from hierc.compiler.cascade.proof import prove_cascade
from hierc.compiler.collector import Collector, Rejected
from hierc.compiler.context import Context
from hierc.compiler.equations.definitions import check_equations
from hierc.compiler.equations.loops import check_loops
from hierc.compiler.imports.linking import link
from hierc.compiler.imports.modules import NO_FILES, Reader, read_modules
from hierc.compiler.imports.views import views, warn_of_unused
from hierc.compiler.model import Group, Model, Node, Source
from hierc.compiler.resolve.constants import file_constants
from hierc.compiler.resolve.declarations import Library
from hierc.compiler.resolve.errors import DeclaredTwice
from hierc.compiler.resolve.names import Names, check_names, names_of
from hierc.compiler.resolve.outside import Given, check_given
from hierc.compiler.shapes.environment import Budget, Environment
from hierc.compiler.structure.elaboration import elaborate
from hierc.compiler.structure.experiments import (
    Choice,
    check_gifts,
    choose,
    resolve_experiment,
    resolve_gifts,
    runnable_agents,
)
from hierc.compiler.structure.flat import Flat
from hierc.compiler.structure.flatten import flatten
from hierc.compiler.structure.instances import instances
from hierc.compiler.structure.nodes import make_nodes
from hierc.compiler.structure.parameters import ParameterBuilder, Parameters
from hierc.compiler.structure.relations import told_once, warn_of_jumps
from hierc.compiler.units.checks import check_declared_units, check_experiment_units, check_units
from hierc.grammar import tree
from hierc.grammar.problems import ModelError, Problem


def analyse(
    file: tree.File,
    *,
    experiment: str | None = None,
    overrides: Given | None = None,
    strict_units: bool = False,
    reader: Reader = NO_FILES,
) -> Model:
    """The structured model of a file.

    `reader` finds the files that it imports. `experiment` names what runs (see `experiments.choose`). `overrides` gives parameters by path,
    numbers or nested lists in their declared units: all are checked for name, type and shape, and those of structural parameters are built
    into the model; the others leave it as it is. `strict_units`: no plain number but 0 takes its neighbour's unit. Raises ModelError with all problems.
    """
    problems = Collector()
    library, names = _definitions(file, reader, strict_units, problems)
    choice = choose(library, experiment, problems)
    problems.stop_on_errors()
    return _model(library, names, choice, overrides or {}, strict_units, problems)


def check_file(
    file: tree.File, *, strict_units: bool = False, reader: Reader = NO_FILES
) -> tuple[Problem, ...]:
    """Check a file as it stands: every experiment in it; where there is none, the only agent that no other contains or, of several such,
    every one that can run on its own.

    Returns the warnings. Raises ModelError with all problems. The other agents are checked for names, equations and units. `strict_units`
    and `reader` are as for `analyse`.
    """
    problems = Collector()
    library, names = _definitions(file, reader, strict_units, problems)
    for name in library.experiments or runnable_agents(library):
        found = Collector()
        try:
            choice = choose(library, name, found)
            found.stop_on_errors()
            for warning in _model(library, names, choice, {}, strict_units, found).warnings:
                problems.add(warning)
        except ModelError as error:
            for problem in error.problems:
                problems.add(problem)
    problems.stop_on_errors()
    return told_once(problems.in_source_order())


def _definitions(
    file: tree.File, reader: Reader, strict_units: bool, problems: Collector
) -> tuple[Library, Names]:
    """What a file and those that it imports define, checked by their texts alone."""
    modules = read_modules(file, reader, problems)
    problems.stop_on_errors()
    files = views(modules, reader.elsewhere, problems)
    problems.stop_on_errors(but=(DeclaredTwice.code,))  # the name is there, though not what it stands for
    clear = not problems.has_errors()
    for view in files:
        check_names(view.own, view.scope, problems)
        check_declared_units(view.own, problems)
        if clear:
            check_equations(view.own, problems)
    problems.stop_on_errors()
    for view in files:
        warn_of_unused(view, problems)
    library = link(files)
    names = names_of(library, problems)
    check_units(library, names, problems, strict=strict_units)
    tables, data = read_tables(library.tables, reader, problems)
    externs = make_externs(library.externs, problems)
    problems.stop_on_errors()
    return replace(library, callees={**tables, **externs}, sources=(*library.sources, *data)), names


def _model(
    library: Library, names: Names, choice: Choice, overrides: Given, strict_units: bool, problems: Collector
) -> Model:
    """Build the chosen model."""
    budget = Budget()
    context = Context(
        library, names, file_constants(library, names.consts, budget, problems), budget, problems
    )
    try:
        outline = instances(library, choice.agent)
    except Rejected as rejection:
        problems.rejected(rejection)
        outline = ()
    problems.stop_on_errors()
    gifts = resolve_gifts(library, choice.experiment, outline, problems)
    problems.stop_on_errors()
    if choice.experiment is not None:
        check_experiment_units(library, names, choice.experiment, problems, strict=strict_units)
        problems.stop_on_errors()
    agents, parameters = elaborate(context, outline, ParameterBuilder(context, gifts.arguments, overrides))
    problems.stop_on_errors()
    check_given(parameters.entries, overrides)
    check_gifts(gifts, agents, _outside(context, parameters), problems)
    problems.stop_on_errors()
    flat = flatten(context, agents, parameters, choice.experiment, gifts.initials)
    check_loops(flat, problems)
    problems.stop_on_errors()
    return _arranged(context, flat, parameters, choice)


def _outside(context: Context, parameters: Parameters) -> Environment:
    """What an experiment sees: the file's constants, and the parameters of the agent that runs."""
    return replace(context.environment(), scope=parameters.by_instance[0])


def _arranged(context: Context, flat: Flat, parameters: Parameters, choice: Choice) -> Model:
    """Prove the cascade, group the nodes, and put everything in order."""
    agent, problems = choice.agent, context.problems
    made = make_nodes(flat, parameters.tables)
    local = made.nodes
    cascade = prove_cascade(flat.instances, flat.nodes, local, problems)
    problems.stop_on_errors()
    grouping = make_groups(agent.name, flat.instances, flat.nodes, local, cascade, problems)
    moved = Moved([here.node for here in local], grouping.order)
    nodes = tuple(moved.node(local[old].node, new) for new, old in enumerate(grouping.order))
    groups = tuple(moved.group(family) for family in grouping.families)
    variables = tuple(replace(v, elements=moved.sources(v.elements)) for v in made.variables)
    experiment = resolve_experiment(
        choice.experiment, _outside(context, parameters), nodes, groups, variables, problems
    )
    problems.stop_on_errors()
    warn_of_jumps(nodes, problems)
    return Model(
        name=agent.name,
        doc=agent.definition.doc,
        sources=context.library.sources,
        parameters=parameters.entries,
        parameter_count=parameters.tables.count,
        nodes=nodes,
        groups=groups,
        variables=variables,
        experiment=experiment,
        warnings=told_once(problems.in_source_order()),
        constants=parameters.tables.constants(),
        order=None if grouping.group_order is None else Column(grouping.group_order),
    )


class Moved:
    """Nodes in another order: elements are numbered anew."""

    def __init__(self, nodes: Sequence[Node], order: Sequence[int]) -> None:
        counts = [nodes[old].count for old in order]
        self._first = np.cumsum([0, *counts])
        self._number = np.empty(int(self._first[-1]), np.int64)
        for new, old in enumerate(order):
            elements = np.arange(nodes[old].count)
            self._number[nodes[old].first + elements] = self._first[new] + elements

    def node(self, node: Node, new: int) -> Node:
        """A node in its new place, reading from elements by their new numbers."""
        return replace(node, id=new, first=int(self._first[new]), inputs=self.sources(node.inputs))

    def group(self, family: Family) -> Group:
        """A family of groups as the model has it."""
        columns = tuple(column_of(self._number[elements]) for _, elements in family.nodes)
        indices = tuple(column(c) for c in family.indices)
        return Group(family.name, columns, len(family.labels), indices)

    def sources(self, sources: Iterable[Source]) -> tuple[Source, ...]:
        """Sources with the new numbers of their elements."""
        return tuple(replace(source, node=mapped(source.node, self._number)) for source in sources)
