"""The commands of the command line: `run`, `bench`, `check`, `params`, `compile`, `graph`, `fmt`, `explain`.

Each takes the parsed arguments and returns an exit code. What the user got wrong is a UsageError or a ModelError; cli.py words the rest.
"""

from __future__ import annotations

import json
import keyword
import math
import shutil
import sys
import time
from argparse import Namespace
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from warnings import catch_warnings, simplefilter

from hierc import loader
from hierc.exits import INTERRUPTED, NUMERICAL_FAILURE, OK, USAGE, UsageError
from hierc.outputs import STDOUT, Outputs, Written, asked_for, check_writable, saved_by, write, writing
from hierc.screen import (
    Progress,
    duration,
    groupings,
    say,
    show_costs,
    show_groups,
    show_problems,
    show_verification,
)
from hierc.version import __version__

if TYPE_CHECKING:
    from hierc.runtime.families import FamilyStats
    from hierc.runtime.model import Model
    from hierc.runtime.result import Result

_SETTINGS = ("start", "stop", "rtol", "atol", "method", "interval", "max_step", "group", "threads")


def check(arguments: Namespace) -> int:
    """Report every problem of a model; run nothing."""
    from hierc.compiler.driver import check_source

    text = loader.read_file(arguments.file)
    strict = arguments.units == "strict"
    warnings = check_source(text.source, strict_units=strict, reader=text.finder)  # raises ModelError
    if arguments.json or warnings:
        show_problems(warnings, as_json=arguments.json)
    say(f"{text.source.name}: no errors")
    return OK


def params(arguments: Namespace) -> int:
    """List a model's parameters."""
    from hierc import parameters

    given = parse_params(arguments.params)
    model = loader.prepare(loader.read_file(arguments.file), arguments.experiment, given).model
    if arguments.json:
        _print_json({"model": model.plan.name, "parameters": parameters.listed(model)})
    else:
        sys.stdout.write(parameters.table(model))
    return OK


def compile(arguments: Namespace) -> int:
    """Write the generated module, or print what a phase made."""
    from hierc.compiler.driver import emit

    if arguments.output and arguments.output != "-":
        _check_module(Path(arguments.output), python=arguments.emit == "python")
    model = loader.read_file(arguments.file)
    text = emit(
        model.source,
        arguments.emit,
        arguments.experiment,
        parse_params(arguments.params),
        strict_units=arguments.units == "strict",
        reader=model.finder,
    )
    if arguments.output in (None, "-"):
        sys.stdout.write(text)
        return OK
    from hierc.runtime.files import write_whole

    with writing(arguments.output):
        write_whole(Path(arguments.output), text.encode())
    say(f"written: {arguments.output}")
    return OK


def run(arguments: Namespace) -> int:
    """Simulate an experiment, write what was asked for, tell how it went; stdout comes last, as its reader may be gone."""
    from hierc.runtime.writers import print_csv

    if arguments.compare:
        return _compare(arguments)
    if STDOUT in arguments.output and arguments.json:
        raise UsageError("-o - and --json both want stdout; write the table to a file")
    outputs = asked_for(arguments.output, arguments.plot)
    params = parse_params(arguments.params)
    began = time.perf_counter()
    source, strict = loader.read_file(arguments.file), arguments.units == "strict"
    loaded = loader.prepare(source, arguments.experiment, params, strict_units=strict)
    compiled = time.perf_counter()
    if not arguments.quiet:
        for warned in loaded.warnings:
            say(warned.text)
    if not arguments.output:
        outputs = replace(outputs, tables=saved_by(loaded.model))
    result = _simulate(loaded.model, arguments)
    ended = time.perf_counter()
    written = write(result, outputs) if result.t_reached > result.start else Written((), ())
    if not arguments.quiet:
        _report(result, loaded, compiled - began, ended - compiled)
        _report_files(result, written, outputs)
    for failure in written.failures:
        say(f"hierc: error: {failure}")
    code = _exit_code(result, written)
    if arguments.json:
        _print_json(summary(result, loaded, written))
    elif outputs.stdout and result.t_reached > result.start:
        print_csv(sys.stdout, result.t, result.columns())
    return code


def bench(arguments: Namespace) -> int:
    """Compare our runs of an experiment with other solvers at equal error."""
    from importlib.util import find_spec

    if find_spec("scipy") is None:
        raise UsageError("hierc bench compares with scipy's solvers: pip install scipy")
    from hierc import bench, bench_plot
    from hierc.runtime.plotting import SUFFIXES, require_matplotlib

    path = Path(arguments.output) if arguments.output else None
    if path is not None:
        check_writable(path, SUFFIXES)
        try:
            require_matplotlib()
        except ImportError as error:
            raise UsageError(str(error)) from None
    params = parse_params(arguments.params)
    model = loader.prepare(loader.read_file(arguments.file), arguments.experiment, params).model
    given = {name: getattr(arguments, name) for name in ("start", "stop", "max_step")}
    given = {name: value for name, value in given.items() if value is not None}
    own = {k: v for k, v in model.plan.experiment.settings.items() if k in ("start", "max_step")}
    settings = {"start": 0.0, "max_step": math.inf, **own, **given, "stop": _check_stop(model, given)}
    found = bench.bench(model, settings, arguments.tolerances or bench.TOLERANCES, arguments.time_limit, say)
    if arguments.json:
        _print_json(asdict(found))
    else:
        sys.stdout.write(bench.report(found))
    if path is not None:
        with writing(path):
            bench_plot.draw(found, path)
        say(f"written: {path}")
    return OK


def _compare(arguments: Namespace) -> int:
    """Measure groupings and print the table, or as JSON."""
    from hierc.runtime.errors import ExternError, SettingError

    for name in ("output", "plot", "group", "verify", "costs"):
        if getattr(arguments, name):
            option = "-o" if name == "output" else f"--{name}"
            raise UsageError(f"--compare tries many groupings and keeps no results; leave out {option}")
    source, strict = loader.read_file(arguments.file), arguments.units == "strict"
    loaded = loader.prepare(source, arguments.experiment, parse_params(arguments.params), strict_units=strict)
    model, settings = loaded.model, _given(arguments)
    _check_stop(model, settings)
    try:
        rows = model.compare_groups(**settings, announce=None if arguments.quiet else say)
    except (SettingError, ExternError) as error:
        raise UsageError(str(error)) from error
    if arguments.json:
        _print_json({"model": model.plan.name, "groupings": [asdict(row) for row in rows]})
    else:
        sys.stdout.write(groupings(rows))
    return OK if any(row.measured is not None for row in rows) else NUMERICAL_FAILURE


def graph(arguments: Namespace) -> int:
    """Show the structure of a model as a table, or write it as a picture or as data."""
    from hierc import graph, picture
    from hierc.compiler.diagram import diagram
    from hierc.compiler.driver import model_of
    from hierc.runtime.files import write_whole

    path = Path(arguments.output) if arguments.output else None
    if path is not None:
        check_writable(path, (*picture.SUFFIXES, *graph.WRITERS))
    params = parse_params(arguments.params)
    text = loader.read_file(arguments.file)
    shown = diagram(model_of(text.source, arguments.experiment, params, reader=text.finder))
    if path is None:
        marks = graph.marks_for(sys.stdout.encoding)
        sys.stdout.write(graph.to_text(shown, marks, shutil.get_terminal_size((100, 24)).columns))
        return OK
    try:
        with writing(path):
            if path.suffix in graph.WRITERS:
                write_whole(path, graph.WRITERS[path.suffix](shown).encode())
            else:
                picture.draw(shown, path)
    except ImportError as error:
        raise UsageError(str(error)) from None
    say(f"written: {path}")
    return OK


def fmt(arguments: Namespace) -> int:
    """Lay out model files in one style."""
    from hierc import fmt

    return fmt.fmt(arguments)


def explain(arguments: Namespace) -> int:
    """Print the page of a problem's code, or the list of all codes."""
    from hierc import explain

    sys.stdout.write(explain.explain(arguments.code) + "\n" if arguments.code else explain.index())
    return OK


def parse_params(texts: Iterable[str]) -> dict[str, Any]:
    """`name=value` pairs; a value is a number, `true`, `false`, or a list `[1, 2]` of them. Raises UsageError."""
    params: dict[str, Any] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not name:
            raise UsageError(f"-p wants NAME=VALUE, as in -p cart.kv=60, not `{text}`")
        if name in params:
            raise UsageError(f"-p gives `{name}` twice")
        try:
            params[name] = json.loads(value)
        except ValueError:
            params[name] = None
        if not _is_value(params[name]):
            raise UsageError(
                f"-p {name}: `{value}` is not a number (a plain one, in the declared unit), `true`, `false`, or a list of them"
            )
    return params


def _is_value(value: object) -> bool:
    match value:
        case bool() | int():
            return True
        case float():
            return math.isfinite(value)
        case [_, *_]:
            return all(map(_is_value, value))
        case _:
            return False


def _simulate(model: Model, arguments: Namespace) -> Result:
    from hierc.runtime.errors import ExternError, RunWarning, SettingError
    from hierc.runtime.result import Interrupted, SimulationError

    settings = _given(arguments)
    stop = _check_stop(model, settings)
    start = settings.get("start", model.plan.experiment.settings.get("start", 0.0))
    shown = not arguments.quiet
    with Progress(model.plan.name, start, stop, shown=shown) as progress, catch_warnings():
        try:
            simplefilter("ignore", RunWarning)  # the report has them
            return model.simulate(
                **settings,
                verify=arguments.verify,
                costs=arguments.costs,
                progress=progress,
                announce=None if arguments.quiet else say,
            )
        except (SimulationError, Interrupted) as error:
            return error.result
        except (SettingError, ExternError) as error:
            raise UsageError(str(error)) from error


def _given(arguments: Namespace) -> dict[str, Any]:
    """The settings of a run that the command line gives."""
    return {name: getattr(arguments, name) for name in _SETTINGS if getattr(arguments, name) is not None}


def _check_stop(model: Model, settings: Mapping[str, Any]) -> float:
    """When the run is to stop. Raises UsageError where nobody says."""
    stop: float | None = settings.get("stop", model.plan.experiment.settings.get("stop"))
    if stop is None:
        raise UsageError(
            "how long should it run? give --stop SECONDS, or name an experiment that has a `stop`"
        )
    return stop


def _check_module(path: Path, *, python: bool) -> None:
    """Refuse a file that could not be written, or not be imported once it is."""
    check_writable(path, (".py",) if python else None)
    if python and (not path.stem.isidentifier() or keyword.iskeyword(path.stem)):
        raise UsageError(
            f"cannot write `{path}`: no module of this name can be imported; take letters, digits and `_`"
        )


def summary(result: Result, loaded: loader.Loaded, written: Written) -> dict[str, Any]:
    """The run as plain data, for --json."""
    return {
        "hierc": __version__,
        "model": result.model,
        "ok": result.status.ok,
        "status": result.status.message,
        "start": result.start,
        "stop": result.stop,
        "reached": result.t_reached,
        "settings": _plain(result.settings),
        "parameters": _plain(result.params),
        "groups": {f.name: _group(result, f) for f in result.families},
        "costs": None if result.costs is None else asdict(result.costs),
        "verification": None if result.verification is None else asdict(result.verification),
        "files": list(written.files),
        "not_written": list(written.failures),
        "warnings": [warned.data for warned in loaded.warnings],
        "run_warnings": list(result.warnings),
    }


def _group(result: Result, family: FamilyStats) -> object:
    """How a group was integrated, or all those of an array together."""
    facts = asdict(family if family.groups > 1 else result.stats[family.name])
    facts.pop("name", None)
    return _plain(facts)


def _print_json(data: Mapping[str, Any]) -> None:
    sys.stdout.write(json.dumps(_plain(data), indent=2, allow_nan=False) + "\n")


def _plain(value: object) -> object:
    """JSON has no infinities and NaNs: null."""
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _report(result: Result, loaded: loader.Loaded, compiling: float, running: float) -> None:
    say(
        f"{result.model}: {result.start:g} to {result.t_reached:g} s, "
        f"simulated in {duration(running)} after {duration(compiling)} of preparation"
    )
    if result.families:
        show_groups(result.families)
    elif result.status.ok:
        say("  no states: nothing to integrate")
    if result.gain is not None:
        say(
            f"groups joined: predicted to be {result.gain:.2g} times as fast as by levels; --compare measures it"
        )
    if result.costs is not None:
        show_costs(result.costs)
    if result.verification is not None:
        show_verification(result.verification)
    for text in result.warnings:
        say(f"warning: {text}")
    for name, value in result.params.items():
        anew = ", recompiled for it" if loaded.compiled and name in loaded.model.built else ""
        say(f"set: {name} = {value}{anew}")


def _report_files(result: Result, written: Written, outputs: Outputs) -> None:
    for name in written.files:
        say(f"written: {name}")
    if result.status.ok and outputs == Outputs((), (), stdout=False):
        say("nothing written: -o FILE keeps the results, --plot FILE draws them")


def _exit_code(result: Result, written: Written) -> int:
    if result.status.ok:
        return USAGE if written.failures else OK
    kept = f"; what was computed until then is in {' and '.join(written.files)}" if written.files else ""
    say(f"hierc: {result.status.message}{kept}")
    return INTERRUPTED if result.status.name == "INTERRUPTED" else NUMERICAL_FAILURE
