"""Units of single expressions and of whole texts, for the tests of this folder."""

from __future__ import annotations

from hierc.compiler.collector import Collector
from hierc.compiler.front import analyse
from hierc.compiler.resolve.declarations import declare
from hierc.compiler.resolve.names import names_of
from hierc.compiler.units.agreement import Rules
from hierc.compiler.units.checks import AgentScope, check_declared_units, check_units
from hierc.compiler.units.inference import FileScope, Inference, Shared
from hierc.compiler.units.quantity import Quantity
from hierc.compiler.units.spelling import Spellings
from hierc.grammar.parser import parse
from hierc.grammar.problems import ModelError, Problem
from hierc.grammar.source import SourceFile

WORLD = """
const int two = 2;
func real twice(real a) = 2*a;
func real[2] pair(real a, real b) = [a, b];
func real area(real a [m], real b [m]) = a*b;
func real drag(real v [m/s]) = v*abs(v);
func real spread(real a, real b) = a - b;
func real late(real t [ms]) = t;
func real element(real[2] p, int i) = p[i];
agent World(int n = 3, real te [ms] = 0 [ms], real free = 1) {
  read real x [m], y [m], z [m], v [m/s], th [rad], F [N];
  read real[2] P [m], V [m];
  read real[2,2] M [kg], H;
  let let_x = x + y;
  let let_rate = let_x/time;
  let both = pair(x, v);
  let columns = transpose([both, both]);
"""


def unit_of(expression: str, world: str = WORLD, *, strict: bool = False) -> tuple[Quantity, list[Problem]]:
    """The unit of an expression among the names of `world`, an agent without its end, and all that is wrong with it."""
    problems = Collector()
    file = parse(SourceFile("test.hier", f"{world} let result = {expression}; }}"))
    library = declare(file, problems)
    (agent,) = library.agents.values()
    names = names_of(library, problems)
    found = Collector()
    shared = Shared(library, Rules(strict, Spellings([]), found.add))
    scope = AgentScope(library, agent, FileScope(library, {}))
    for name in names.lets[agent.name]:
        scope.lets[name] = Inference(shared, scope).quantity(agent.lets[name].let.value)
    return scope.lets["result"], list(found.in_source_order())


def codes(text: str, agent: str | None = "A") -> list[str]:
    """The codes of the problems of a model; without an agent, those of units alone, whatever else is wrong."""
    file = parse(SourceFile("test.hier", text))
    if agent is None:
        problems = Collector()
        library = declare(file, Collector())
        names = names_of(library, Collector())
        check_declared_units(library, problems)
        check_units(library, names, problems, strict=False)
        return [p.code for p in problems.in_source_order()]
    try:
        return [p.code for p in analyse(file).warnings]
    except ModelError as error:
        return [p.code for p in error.problems if p.severity == "error"]
