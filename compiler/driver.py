"""The compiler from end to end: it only sequences the phases, and can show what each of them made.

text --parse--> tree --front--> model --symbolic--> programs --plan--> tables --emit--> Python
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, assert_never, get_args

from hierc.compiler.arrays.elements import plain
from hierc.compiler.callees.callee import Extern
from hierc.compiler.front import analyse, check_file
from hierc.compiler.imports.modules import NO_FILES, Reader
from hierc.compiler.model import Model
from hierc.grammar.parser import parse
from hierc.grammar.problems import Problem
from hierc.grammar.source import SourceFile

if TYPE_CHECKING:
    from hierc.compiler.symbolic.derive import Symbolic

Stage = Literal["ast", "model", "cascade", "symbolic", "plan", "python"]
STAGES: tuple[Stage, ...] = get_args(Stage)


@dataclass(frozen=True, slots=True)
class Compiled:
    """The text of a generated module, with the compiler's warnings and the paths of the parameters that are built into it."""

    text: str
    warnings: tuple[Problem, ...]
    structural: tuple[str, ...]
    externs: tuple[Extern, ...]  # the external functions that it imports


def compile_source(
    source: SourceFile,
    experiment: str | None = None,
    params: Mapping[str, object] | None = None,
    *,
    strict_units: bool = False,
    reader: Reader = NO_FILES,
) -> Compiled:
    """Compile a model. `params`: parameters by path, in their declared units; `strict_units`: no plain number but 0 takes a unit; `reader`
    finds the files that are imported.

    Raises ModelError with all problems.
    """
    model = model_of(source, experiment, params, strict_units=strict_units, reader=reader)
    from hierc.compiler.symbolic.derive import derive

    structural = tuple(dict.fromkeys(plain(p.path) for p in model.parameters if p.structural))
    symbolic = derive(model)
    externs = tuple(c.callee for c in symbolic.called if isinstance(c.callee, Extern))
    return Compiled(_python(model, symbolic), model.warnings, structural, externs)


def model_of(
    source: SourceFile,
    experiment: str | None = None,
    params: Mapping[str, object] | None = None,
    *,
    strict_units: bool = False,
    reader: Reader = NO_FILES,
) -> Model:
    """The structured model of a source file. Arguments and errors as for `compile_source`."""
    return analyse(
        parse(source), experiment=experiment, overrides=params, strict_units=strict_units, reader=reader
    )


def check_source(
    source: SourceFile, *, strict_units: bool = False, reader: Reader = NO_FILES
) -> tuple[Problem, ...]:
    """Check everything in a file and give its warnings. Raises ModelError with all problems."""
    return check_file(parse(source), strict_units=strict_units, reader=reader)


def emit(
    source: SourceFile,
    stage: str,
    experiment: str | None = None,
    params: Mapping[str, object] | None = None,
    *,
    strict_units: bool = False,
    reader: Reader = NO_FILES,
) -> str:
    """What a phase made, as text. `stage` is one of `STAGES`; ValueError for another. Other arguments and errors as for `compile_source`."""
    from hierc.compiler.dump import dump_cascade, dump_model, dump_tree

    chosen = next((s for s in STAGES if s == stage), None)
    if chosen is None:
        raise ValueError(f"no stage {stage!r}: choose from {', '.join(STAGES)}")
    if chosen == "ast":
        return dump_tree(parse(source).items)
    model = model_of(source, experiment, params, strict_units=strict_units, reader=reader)
    match chosen:
        case "model":
            return dump_model(model)
        case "cascade":
            return dump_cascade(model)
        case "symbolic":
            from hierc.compiler.symbolic.derive import derive

            return dump_tree(derive(model))
        case "plan":
            from hierc.compiler.emission.plan import plan
            from hierc.compiler.symbolic.derive import derive

            return dump_tree(plan(model, derive(model)))
        case "python":
            from hierc.compiler.symbolic.derive import derive

            return _python(model, derive(model))
        case _ as never:
            assert_never(never)


def _python(model: Model, symbolic: Symbolic) -> str:
    from hierc.compiler.emission.emit import emit as emit_plan
    from hierc.compiler.emission.plan import plan

    return emit_plan(plan(model, symbolic))
