"""Imports inside the compiler: every file has names of its own, and what is linked means what one file would mean."""

from __future__ import annotations

import re
from collections.abc import Mapping

import pytest

from hierc.compiler.driver import compile_source
from hierc.compiler.dump import dump_model
from hierc.compiler.front import analyse
from hierc.compiler.imports.modules import MAX_FILES, Missing, file_of
from hierc.grammar.parser import parse
from hierc.grammar.problems import ModelError
from hierc.grammar.source import SourceFile
from hierc.loader import run_module
from hierc.runtime.model import Model


class Files:
    """A reader of texts in memory: all files in one folder. `asked` counts readings."""

    elsewhere: Mapping[str, str] = {}

    def __init__(self, files: Mapping[str, str]) -> None:
        self.files = {file_of(name): SourceFile(file_of(name), text) for name, text in files.items()}
        self.asked: list[str] = []

    def find(self, importer: str, module: str) -> SourceFile | Missing:
        self.asked.append(module)
        assert importer in self.files
        return self.files.get(file_of(module)) or Missing(file_of(module))


def compiled(main: str, experiment: str | None = None, **others: str) -> Model:
    files = Files({"main": main, **{name.replace("__", "."): text for name, text in others.items()}})
    text = compile_source(files.files["main.hier"], experiment, reader=files).text
    model: Model = run_module(text, "main.hier").MODEL
    return model


def rates(model: Model) -> list[float]:
    return model.rhs(0.0, model.initial()).tolist()


def codes(main: str, **others: str) -> list[str]:
    files = Files({"main": main, **others})
    try:
        found = analyse(parse(files.files["main.hier"]), reader=files).warnings
    except ModelError as error:
        found = error.problems
    return [problem.code for problem in found]


def test_a_model_in_pieces_is_the_model_in_one_piece() -> None:
    gravity = "const real g [m/s^2] = 9.81;"
    half = "func real half(real x) = x/2;"
    body = """agent Body(real m [kg] = 2 [kg], real h0 [m] = 1 [m]) {{
      read real push [N];
      write real h [m] = {0}half(h0), v [m/s] = 0;
      let a = push/m - {1}g;
      diff {{ h' = v; v' = a - {0}half(0.5 [1/s])*v; }}
    }}"""
    top = """agent Top(real k = 3) {{
      write real y = 0;
      agent b = {0}Body(m = 4 [kg]) [push := {1}g*1 [kg]];
      diff {{ y' = {2}half(k) - y*b.h/(1 [m]); }}
    }}
    experiment e of Top(b.h0 = 3 [m]) {{ init {{ b.v = {1}g*1 [s]; }} stop = 1; }}"""
    one = compiled("\n".join([gravity, half, body.format("", ""), top.format("", "", "")]))
    pieces = compiled(
        f"import parts.bodies as b; import consts; from math import half;\n{top.format('b.', 'consts.', '')}",
        consts=gravity,
        math=half,
        parts__bodies=f"import math;\nfrom consts import g;\n{body.format('math.', '')}",
    )
    assert one.initial().tolist() == pieces.initial().tolist() == [1.5, 9.81, 0]
    assert rates(one) == rates(pieces)
    assert list(one.parameters) == list(pieces.parameters)


def test_every_file_has_names_of_its_own() -> None:
    """Both files define `Part`, `k`, `n` and `twice`; the main one also `sin` and `pi`, which the other uses as they are built in."""
    model = compiled(
        """
        import other;
        const real k = 1;
        const int n = 5;
        const real pi = 3;
        func real twice(real x) = 2*x;
        func real sin(real x) = 100*x;
        agent Part() { write real x = 0; diff { x' = twice(k) + sin(1) + pi; } }
        agent Top() { agent a = Part(); agent b = other.Part(); agent c = other.Uses(); }
        """,
        other="""
        const real k = 10;
        func real twice(real x) = 20*x;
        func real total(real[n] x) = sum(x)/n;
        agent Part() { write real x = 0; diff { x' = twice(k) + sin(pi/2); } }
        agent Uses(real k = 7) { write real x = 0; let n = 3; diff { x' = total([k, n]) + sum([pi for k in 1..2])/pi; } }
        """,
    )
    assert [c.name for c in model.plan.classes] == ["Part", "other.Part", "other.Uses"]
    assert rates(model) == [105, 201, 7]


def test_local_names_hide_imported_ones() -> None:
    model = compiled(
        """
        from other import k, twice;
        import other as o;
        agent Inner() { write real g = 4; diff { g' = 0; } }
        agent A(real k = 5) { write real x = 0; diff { x' = k + o.k; } }
        agent B() { write real[2] x = [0, 0]; for_each: }
        """.replace("for_each: ", "diff { for k in 1..2 { x[k]' = k; } }")
        + """
        agent C() { agent o = Inner(); write real x = 0; diff { x' = o.g + twice(k); } }
        agent Top() { agent a = A(); agent b = B(); agent c = C(); }
        """,
        other="const real k = 10; func real twice(real x) = 2*x; const real g = 1;",
    )
    assert sorted(rates(model)) == [0, 1, 2, 15, 24]


def test_experiments_of_imported_files_are_not_run() -> None:
    other = "agent B() { write real x = 0; diff { x' = 1; } } experiment loose of B() { stop = 5; }"
    main = "import other; agent A() { agent b = other.B(); } experiment e of A() { stop = 3; }"
    assert compiled(main, other=other).plan.experiment.name == "e"
    with pytest.raises(ModelError, match="no experiment or agent `loose`"):
        compiled(main, "loose", other=other)
    with pytest.raises(ModelError, match="no experiment or agent `B`"):
        compiled(main, "B", other=other)


def test_an_experiment_of_an_imported_agent() -> None:
    model = compiled(
        "import other as o; from other import k; experiment e of o.B(a = o.k) [u := k*time] { stop = k; method = radau9; }",
        other="const real k = 4; const real radau9 = 0; agent B(real a) { read real u; write real x = a; diff { x' = u; } }",
    )
    assert model.initial().tolist() == [4]
    assert model.rhs(2.0, [0.0]).tolist() == [8]
    assert model.plan.experiment.settings == {"stop": 4.0, "method": "radau9"}


def test_subscripts_and_vectors_of_other_files() -> None:
    model = compiled(
        """
        import tables as t;
        agent A() { write real[t.n] x = t.start; diff { x' = [t.gains[1, i]*x[t.order[i]] for i in 1..t.n]; } }
        """,
        tables="""
        const int n = 3;
        const real[n] start = [1, 2, 3];
        const real[2,n] gains = [[4, 5, 6], [0, 0, 0]];
        const int[n] order = [3, 1, 2];
        """,
    )
    assert rates(model) == [12, 5, 12]


def test_arrays_of_imported_agents() -> None:
    """An index hides a constant of another file as it hides one of its own."""
    cars = """
        const real gap = 10;
        const real i = 100;
        agent Car(real x0 = 0) { read real lead; write real x = x0; diff { x' = lead - x - gap; } }
        agent Fleet(int n) {
          read real lead;
          agent c[i in 1..n] = Car(x0 = -gap*i) [lead := if i == 1 then lead else c[i - 1].x];
        }
    """
    top = """
        agent Top() {{
          agent car[i in 1..4] = {0}Car(x0 = i*{0}gap) [lead := if i == 1 then {0}gap else car[i - 1].x];
          agent f = {0}Fleet(n = 3) [lead := i];
        }}
    """
    one = analyse(parse(SourceFile("main.hier", cars + top.format(""))))
    files = Files({"main": f"import cars as m; from cars import i; {top.format('m.')}", "cars": cars})
    two = analyse(parse(files.files["main.hier"]), reader=files)
    assert dump_model(two).replace("cars.", "") == dump_model(one)


def test_importers_see_only_what_they_import() -> None:
    second = "agent C() { write real x = 0; diff { x' = 1; } } const real k = 1;"
    first = "import second; agent B() { agent c = second.C(); }"
    for use in ("second.C()", "first.second.C()", "C()"):
        assert codes(f"import first; agent A() {{ agent b = first.B(); agent c = {use}; }}", first=first, second=second) == [
            "E207"
        ]  # fmt: skip
    assert codes("import first; agent A() { agent b = first.B(); write real y; alge { y = k; } }", first=first, second=second) == [
        "E201"
    ]  # fmt: skip


def test_an_imported_file_does_not_see_the_main_one() -> None:
    assert codes(
        "import other; const real k = 1; func real f(real x) = x; agent A() { agent b = other.B(); }",
        other="agent B() { write real x = 0; diff { x' = f(k); } }",
    ) == ["E213", "E201"]


def test_a_file_that_two_import_is_read_once() -> None:
    files = Files(
        {
            "main": "import a; import b; agent T() { agent x = a.X(); agent y = b.Y(); }",
            "a": "import base; agent X() { write real x = 0; diff { x' = base.k; } }",
            "b": "import base; agent Y() { write real y = 0; diff { y' = base.k; } }",
            "base": "const real k = 2;",
        }
    )
    model = analyse(parse(files.files["main.hier"]), reader=files)
    assert [file.name for file in model.sources] == ["main.hier", "b.hier", "a.hier", "base.hier"]
    assert sorted(files.asked) == ["a", "b", "base", "base"]


def chain(length: int) -> dict[str, str]:
    """A file that imports another that imports another …"""
    files = {f"f{k}": f"import f{k + 1}; const real c = f{k + 1}.c + 1;" for k in range(length)}
    return files | {f"f{length}": "const real c = 0;"}


def test_long_chains_and_long_sums() -> None:
    terms = " + ".join(["f0.c"] * 3000)
    main = f"import f0; agent A() {{ write real x = 0; diff {{ x' = {terms}; }} }}"
    assert rates(compiled(main, **chain(MAX_FILES - 2))) == [3000 * (MAX_FILES - 2)]
    assert codes(main, **chain(MAX_FILES - 1)) == ["E915"]


def test_the_deepest_nesting() -> None:
    deep = f"{'abs(' * 98}k{')' * 98}"
    other = f"const real k = 2; func real f(real k) = {deep}; agent B() {{ write real x = 0; diff {{ x' = {deep}; }} }}"
    main = "import other; agent A() { agent b = other.B(); write real y = 1; diff { y' = other.f(3); } }"
    assert sorted(rates(compiled(main, other=other))) == [2, 3]


def test_a_circle_of_many_files() -> None:
    files = chain(MAX_FILES - 2) | {f"f{MAX_FILES - 2}": "import f0;"}
    assert codes("import f0; agent A() { write real x = f0.c; diff { x' = 1; } }", **files) == ["E902"]


def test_too_much_text() -> None:
    files = {f"f{k}": f"/*{'x' * 2**22}*/" for k in range(4)}
    main = "".join(f"import {name};" for name in files)
    assert codes(f"{main} agent A() {{ write real x = 0; diff {{ x' = 1; }} }}", **files) == ["E915"]


def test_the_order_of_imports_changes_nothing() -> None:
    others = {
        "a": "agent A() { write real x = 1; diff { x' = -x; } }",
        "b": "import a; agent B() { agent i = a.A(); write real y = 0; diff { y' = i.x; } }",
    }
    texts = [
        re.sub(
            "digest='.*'",
            "",
            compile_source(files.files["main.hier"], reader=files).text.split("import math", 1)[1],
        )
        for imports in ("import a; import b;", "import b; import a;")
        for files in [
            Files({"main": f"{imports} agent T() {{ agent p = a.A(); agent q = b.B(); }}", **others})
        ]
    ]
    assert texts[0] == texts[1]
