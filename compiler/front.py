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

from collections.abc import Iterable, Mapping
from dataclasses import replace

from hierc.compiler.callees.externs import make_externs
from hierc.compiler.callees.tables import read_tables
from hierc.compiler.cascade.grouping import make_groups
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
from hierc.compiler.resolve.names import Names, check_names, names_of
from hierc.compiler.resolve.outside import Given, check_given
from hierc.compiler.shapes.evaluate import Budget
from hierc.compiler.structure.experiments import (
    Choice,
    choose,
    resolve_experiment,
    resolve_gifts,
    runnable_agents,
)
from hierc.compiler.structure.flat import Flat
from hierc.compiler.structure.flatten import flatten
from hierc.compiler.structure.instances import instances
from hierc.compiler.structure.nodes import make_nodes
from hierc.compiler.structure.parameters import Parameters, make_parameters
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
    problems.stop_on_errors()
    for view in files:
        check_names(view.own, view.scope, problems)
        check_declared_units(view.own, problems)
        check_equations(view.own, problems)
        warn_of_unused(view, problems)
    problems.stop_on_errors()
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
        agents = instances(library, choice.agent)
    except Rejected as rejection:
        problems.rejected(rejection)
        agents = ()
    problems.stop_on_errors()
    gifts = resolve_gifts(library, choice.experiment, agents, problems)
    problems.stop_on_errors()
    if choice.experiment is not None:
        check_experiment_units(library, choice.experiment, problems, strict=strict_units)
        problems.stop_on_errors()
    parameters = make_parameters(context, agents, gifts.arguments, overrides)
    problems.stop_on_errors()
    check_given(parameters.entries, overrides)
    flat = flatten(context, agents, parameters, choice.experiment, gifts.initials)
    check_loops(flat, problems)
    problems.stop_on_errors()
    return _arranged(context, flat, parameters, choice)


def _arranged(context: Context, flat: Flat, parameters: Parameters, choice: Choice) -> Model:
    """Prove the cascade, group the nodes, and put everything in order."""
    agent, problems = choice.agent, context.problems
    made = make_nodes(flat)
    local = made.nodes
    cascade = prove_cascade(flat.instances, flat.nodes, local, problems)
    problems.stop_on_errors()
    grouping = make_groups(agent.name, flat.instances, flat.nodes, local, cascade, problems)
    place = {old: new for new, old in enumerate(grouping.order)}
    nodes = tuple(_moved(local[old].node, place) for old in grouping.order)
    groups = tuple(Group(group.name, tuple(place[n] for n in group.nodes)) for group in grouping.groups)
    variables = tuple(replace(v, elements=_sources(v.elements, place)) for v in made.variables)
    experiment = resolve_experiment(
        choice.experiment, context.environment(), nodes, groups, variables, problems
    )
    problems.stop_on_errors()
    warn_of_jumps(nodes, problems)
    return Model(
        name=agent.name,
        doc=agent.definition.doc,
        sources=context.library.sources,
        parameters=parameters.entries,
        parameter_count=parameters.count,
        nodes=nodes,
        groups=groups,
        variables=variables,
        experiment=experiment,
        warnings=told_once(problems.in_source_order()),
    )


def _moved(node: Node, place: Mapping[int, int]) -> Node:
    """A node with its new id, reading from nodes by their new ids."""
    return replace(node, id=place[node.id], first=place[node.id], inputs=_sources(node.inputs, place))


def _sources(sources: Iterable[Source], place: Mapping[int, int]) -> tuple[Source, ...]:
    return tuple(replace(source, node=place[source.node]) for source in sources)
