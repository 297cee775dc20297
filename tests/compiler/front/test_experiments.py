"""What runs, and what it is given: experiments, arguments, initial values, values from outside."""

from __future__ import annotations

import pytest
from helpers import gallery, groups, model_of
from interpreter import Interpreter

from hierc.compiler.front import check_file
from hierc.compiler.resolve.outside import check_given
from hierc.grammar.parser import parse
from hierc.grammar.problems import ModelError
from hierc.grammar.source import SourceFile

TEXT = """
const real slow [s] = 4 [s];
agent Lag(real T [s] = 1, real[2] y0 = [1, 2]) {
  read real u;
  write real y = y0[1], z = y;
  diff { y' = (u - y)/T; z' = y0[2]; }
}
agent Chain(int n = 2, real k = 3) {
  read real drive;
  agent a = Lag(T = k*1 [s]) [u := drive];
  agent b = Lag(y0 = [k, n]) [u := a.y];
  write real[n] w = [i for i in 1..n];
  diff { w' = -w; }
}
experiment one of Chain(k = 5, a.T = slow) [drive := if time < 2 then 0.2 else 1] {
  init { b.y = 7; w = [8, 9]; }
  stop = 2 [min]; rtol = 1e-4; method = radau;
  group b { max_step = 1 [ms]; }
  record a.*, w; save "a.csv", "b.npz";
}
experiment two of Chain(n = 3) [drive := 0] { }
"""


def codes(call: object, *args: object, **kwargs: object) -> list[str]:
    with pytest.raises(ModelError) as caught:
        call(*args, **kwargs)
    return [p.code for p in caught.value.problems]


def test_what_an_experiment_gives() -> None:
    model = model_of(TEXT, experiment="one")
    interpreter = Interpreter(model)
    values = dict(
        zip((p.path for p in model.parameters if not p.shape), interpreter.parameters, strict=False)
    )
    assert values["k"] == 5.0
    assert interpreter.start() == {"a.y": 1.0, "a.z": 1.0, "b.y": 7.0, "b.z": 7.0, "w[1]": 8.0, "w[2]": 9.0}
    rates = interpreter.rates(3.0, interpreter.start())
    assert rates["a.y"] == (1 - 1) / 4
    assert interpreter.rates(1.0, interpreter.start())["a.y"] == (0.2 - 1) / 4
    assert rates["b.z"] == 2.0
    experiment = model.experiment
    assert (experiment.settings.stop, experiment.settings.rtol, experiment.settings.method) == (
        120.0,
        1e-4,
        "radau",
    )
    assert experiment.groups[0][0] == "b"
    assert experiment.groups[0][1].max_step == 1e-3
    assert experiment.record == ("a.y", "a.z", "w")
    assert experiment.save == ("a.csv", "b.npz")


def test_parameters_stand_after_what_they_are_made_of() -> None:
    model = model_of(TEXT, experiment="two")
    assert [(p.path, p.first, p.structural) for p in model.parameters] == [
        ("n", 0, True), ("k", 1, False), ("a.T", 2, False), ("a.y0", 3, False), ("b.T", 5, False), ("b.y0", 6, False),
    ]  # fmt: skip
    assert model.parameter_count == 8
    assert Interpreter(model, {"k": 6.0}).parameters == [3.0, 6.0, 6.0, 1.0, 2.0, 1.0, 6.0, 3.0]
    assert len(next(v for v in model.variables if v.path == "w").elements) == 3


def test_values_from_outside() -> None:
    plain = model_of(TEXT, experiment="two")
    assert model_of(TEXT, experiment="two", overrides={"k": 9.0, "a.y0": [1, 2]}) == plain
    assert (
        len(
            next(
                v for v in model_of(TEXT, experiment="two", overrides={"n": 5}).variables if v.path == "w"
            ).elements
        )
        == 5
    )
    check_given(plain.parameters, {"k": 9, "a.y0": (1.0, 2.5), "n": 2.0})
    wrong = {"kk": 1.0, "a.y0": [1, 2, 3], "k": "fast", "n": 2.5, "b.T": float("nan"), "a.T": [[1], [2, 3]]}
    assert sorted(codes(check_given, plain.parameters, wrong)) == ["E206", *["E911"] * 5]
    assert codes(model_of, TEXT, experiment="two", overrides={"a.TT": 1}) == ["E206"]
    assert codes(model_of, TEXT, experiment="two", overrides={"n": 2.5}) == ["E911"]


def test_arguments_at_any_depth_replace_those_of_the_model() -> None:
    text = gallery("cart").nodes[0].span.file.text
    assert (
        Interpreter(gallery("cart")).parameters
        != Interpreter(
            model_of(text.replace("figure8 of Cart4()", "figure8 of Cart4(cart.kv = 60, plan.w = 0.3)"))
        ).parameters
    )


@pytest.mark.parametrize(
    ("text", "experiment", "name", "run"),
    [
        (TEXT, "one", "Chain", "one"),
        ("agent A() { write real x = 0; diff { x' = 1; } }", None, "A", None),
        ("agent A() { agent b = B(); } agent B() { write real x = 0; diff { x' = 1; } }", None, "A", None),
        ("agent A() { agent b = B(); } agent B() { write real x = 0; diff { x' = 1; } }", "B", "B", None),
    ],
)
def test_which_agent_runs(text: str, experiment: str | None, name: str, run: str | None) -> None:
    model = model_of(text, experiment=experiment)
    assert (model.name, model.experiment.name) == (name, run)


def test_no_choice() -> None:
    assert codes(model_of, TEXT, experiment="three") == ["E908"]
    assert codes(model_of, "const real a = 1;") == ["E909"]
    assert codes(model_of, TEXT, experiment="Chain") == ["E203"]


def test_checking_a_file_checks_every_experiment() -> None:
    both = TEXT.replace("(n = 3)", "(n = 3, m = 2)").replace("stop = 2 [min]", "stopp = 2 [min]")
    assert codes(check_file, parse(SourceFile("test.hier", both))) == ["E903", "E206"]


def test_checking_a_file_without_experiments_checks_what_would_run() -> None:
    lag = "agent Lag() { read real u; write real y = 0; diff { y' = u - y; } let unused = 1; }"
    assert codes(check_file, parse(SourceFile("one.hier", lag))) == ["E203", "W511"]
    library = lag + lag.replace("Lag", "Lead")
    assert [w.code for w in check_file(parse(SourceFile("library.hier", library)))] == ["W511", "W511"]
    jumps = "agent {}() {{ write real x = 0; diff {{ x' = sign(x); }} }} "
    warnings = check_file(parse(SourceFile("jumps.hier", jumps.format("A") + jumps.format("B"))))
    assert [(w.code, len(w.help())) for w in warnings] == [("W013", 1), ("W013", 0)]


@pytest.mark.parametrize(
    ("settings", "found"),
    [
        ("stop = 1e-300;", []),
        ("start = -2; stop = -1;", []),
        ("start = 1;", []),
        ("stop = 0;", ["E911"]),
        ("start = 1; stop = 1;", ["E911"]),
        ("stop = 1; start = 2;", ["E911"]),
        ("start = -1e308*10;", ["E911"]),
        ('save "a.csv", "b/../c.npz", "./d.csv";', []),
        ('save "csv", ".csv";', ["E912", "E912"]),
        (
            'save "/a.csv", "../a.csv", "b/../../a.csv", "C:\\\\a.csv", "a\\\\..\\\\..\\\\b.csv";',
            ["E912"] * 5,
        ),
    ],
)
def test_times_and_files(settings: str, found: list[str]) -> None:
    text = f"agent A() {{ write real x = 0; diff {{ x' = 1; }} }} experiment e of A() {{ {settings} }}"
    if found:
        assert codes(model_of, text) == found
    else:
        assert model_of(text).name == "A"


def test_advice_on_paths() -> None:
    text = """
    agent Body(real m = 1, real[3] I = [1, 2, 3], real[1,2] M = [[1, 2]]) { write real x = 0; diff { x' = m; } }
    agent Top() { level body { agent b = Body(); } }
    """
    parameters = model_of(text).parameters

    def advice(path: str) -> tuple[str, ...]:
        with pytest.raises(ModelError) as caught:
            check_given(parameters, {path: 1.0})
        return caught.value.problems[0].help()

    assert advice("body.b.m") == ("did you mean `b.m`? Levels are no part of a path",)
    assert advice("b.I[1]") == ("give the whole vector: `b.I=[…]`",)
    assert advice("b.M[1,2]") == ("give the whole matrix: `b.M=[[…], …]`",)
    assert advice("b.mm") == ("did you mean `b.m`?",)
    assert advice("quite.another") == ()


def test_gallery_settings_of_a_group() -> None:
    assert list(groups(gallery("arm"))) == ["plan", "ik", "body", "motor"]
