"""Names of agents and variables are data: whatever they are, the code is the same and works."""

import ast
import builtins
import keyword

import pytest
from hand import SPAN, Agent, build
from oracle import System, generate

from hierc.compiler.emission.names import class_names
from hierc.compiler.model import Settings, Variable
from hierc.grammar.source import SourceFile

HOSTILE = sorted(
    {
        *keyword.kwlist,
        *keyword.softkwlist,
        *(n for n in dir(builtins) if n.isidentifier()),
        *(
            "E",
            "I",
            "S",
            "N",
            "O",
            "Q",
            "C",
            "nan",
            "inf",
            "lambda",
            "np",
            "t",
            "x",
            "u",
            "d",
            "p",
            "q",
            "y",
            "J",
            "w",
            "dx",
        ),
        *(
            "math",
            "numpy",
            "sympy",
            "Model",
            "Plan",
            "Class",
            "MODEL",
            "CLASSES",
            "NODES",
            "simulate",
            "rhs",
            "jacobian",
        ),
        *(
            "__name__",
            "__file__",
            "__init__",
            "__class__",
            "__builtins__",
            "__import__",
            "_",
            "__",
            "a0",
            "s0",
            "x0",
            "c0",
        ),
        *("parameter_defaults", "EXPERIMENT", "PARAMETERS", "STATES", "GROUPS", "annotations"),
    }
)


def skeleton(text):
    """Functions without their names: what the names must not change."""
    return [
        ast.dump(ast.Module(f.body, []))
        for f in ast.parse(text).body
        if isinstance(f, ast.FunctionDef) and f.name not in ("simulate", "rhs", "jacobian")
    ]


def named(agent, parameter, state, variable):
    a = Agent(agent, agent)
    k = a.parameter(parameter, 2.0)
    x = a.state(state, 1.0)
    v = a.alge(variable, k * x)
    a.diff(state, -v, f"{state}' = -{variable};")
    reader = Agent(f"{agent}2", "Reader")
    reader.diff("z", reader.read(agent, variable, "local") - reader.state("z"))
    return build(agent, [a, reader], {agent: [agent], "second": [f"{agent}2"]}, doc=f"About {agent}.")


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_names_change_no_code(name):
    text = generate(named(name, name + "_", name, name + "__"))
    system = System(text)
    assert skeleton(text) == skeleton(generate(named("Agent", "k", "x", "v")))
    assert system.rates(0.0, [[3.0], [1.0]], 0) == [-6.0]
    assert system.rates(0.0, [[3.0], [1.0]], 1) == [5.0]
    assert system.plan.classes[0].states == (name,)
    assert system.plan.parameters[0].path == f"{name}.{name}_"
    assert system.names["STATES"] == (f"{name}.{name}", f"{name}2.z")
    assert system.names["GROUPS"] == (name, "second")
    assert ast.parse(text)


def test_all_hostile_names_in_one_model():
    agents = []
    for name in HOSTILE:
        a = Agent(name, name)
        k = a.parameter("k", 1.0 + len(agents))
        a.diff("x", -k * a.state("x", 1.0) / (1.0 + len(agents)))  # a literal, so each is a class of its own
        agents.append(a)
    system = System(generate(build("M", agents, {"all": HOSTILE})))
    assert len(system.plan.classes) == len(HOSTILE)
    for n in range(len(HOSTILE)):
        assert system.rates(0.0, [[2.0]] * len(HOSTILE), n) == pytest.approx([-2.0])


def test_class_names_are_injective():
    templates = ["A", "A_2", "A", "A", "A.b", "A_b", "a", "1x", "_1x", "µ", "Ω", ""]
    names = class_names(templates)
    assert len(set(names)) == len(templates)
    assert all(n.isascii() and n.isidentifier() for n in names)
    assert names[:4] == ("A", "A_2", "A_3", "A_4")


EVIL = [
    '"""',
    "'''",
    "\\",
    'x\n__import__("os").system("true")\n',
    "\\N{BULLET}",
    "\r\nimport os",
    "\x00\x1b[31m\u202e",
    "{example} {states} %s",
    "é µ Ω °",
    '\\"""\nraise SystemExit',
]


@pytest.mark.parametrize("evil", EVIL)
def test_text_of_the_user_stays_text(evil):
    a = Agent("a", "A")
    a.diff("x", -a.state("x", 1.0), f"x' = -x; /* {evil} */")
    model = build("M", [a], {"a": ["a"]}, doc=evil, settings=Settings(method=evil), save=(evil,))
    variable = Variable("a.v", (), evil, evil, "write", model.variables[0].elements, SPAN)
    model = type(model)(
        **{
            **{f: getattr(model, f) for f in model.__slots__},
            "variables": (variable,),
            "sources": (SourceFile(evil + ".hier", ""), SourceFile("std/" + evil, evil)),
        }
    )
    text = generate(model)
    names = System(text).names
    plan = names["MODEL"].plan
    assert text.isascii()
    assert (plan.doc, plan.source, plan.variables[0].unit, plan.variables[0].doc) == (
        evil,
        evil + ".hier",
        evil,
        evil,
    )
    assert plan.experiment.settings == {"method": evil}
    assert plan.experiment.save == (evil,)
    if "\x00" not in evil and "\r" not in evil:
        assert evil in ast.get_docstring(ast.parse(text), clean=False)
    assert skeleton(text) == skeleton(generate(build("M", [a], {"a": ["a"]})))
