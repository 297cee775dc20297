"""The commands of the command line: `run`, `check`, `compile`, `graph`, `fmt`, `explain`.

Each takes the parsed arguments and returns an exit code. What the user got wrong is a UsageError or a ModelError; cli.py words the rest.
"""

from __future__ import annotations

import json
import math
import shutil
import sys
import time
from argparse import Namespace
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hierc import loader
from hierc.exits import INTERRUPTED, NUMERICAL_FAILURE, OK, UsageError
from hierc.screen import Progress, duration, say, show_groups, show_problems
from hierc.version import __version__

if TYPE_CHECKING:
    from hierc.runtime.model import Model
    from hierc.runtime.result import Result

TABLES = (".csv", ".npz")
_SETTINGS = ("start", "stop", "rtol", "atol", "method", "interval")


def check(arguments: Namespace) -> int:
    """Report every problem of a model; run nothing."""
    from hierc.compiler.driver import check_source

    source = loader.read(arguments.file)
    warnings = check_source(source, strict_units=arguments.units == "strict")  # raises ModelError
    if arguments.json or warnings:
        show_problems(warnings, as_json=arguments.json)
    say(f"{source.name}: no errors")
    return OK


def compile(arguments: Namespace) -> int:
    """Write the generated module, or print what a phase made."""
    from hierc.compiler.driver import emit

    if arguments.output and arguments.output != "-":
        _writable(Path(arguments.output), (".py",) if arguments.emit == "python" else None)
    text = emit(
        loader.read(arguments.file),
        arguments.emit,
        arguments.experiment,
        parse_params(arguments.params),
        strict_units=arguments.units == "strict",
    )
    if arguments.output in (None, "-"):
        sys.stdout.write(text)
        return OK
    from hierc.runtime.files import write_whole

    write_whole(Path(arguments.output), text.encode())
    say(f"written: {arguments.output}")
    return OK


def run(arguments: Namespace) -> int:
    """Simulate an experiment, tell how it went, write what was asked for."""
    _check_outputs(arguments)
    params = parse_params(arguments.params)
    began = time.perf_counter()
    source, strict = loader.read(arguments.file), arguments.units == "strict"
    loaded = loader.prepare(source, arguments.experiment, params, strict_units=strict)
    compiled = time.perf_counter()
    if not arguments.quiet:
        for text in loaded.warnings:
            say(text)
    saves = [] if arguments.output else _saves(loaded.model)
    result = _simulate(loaded.model, arguments)
    ended = time.perf_counter()
    written = _write(result, arguments, saves) if result.t_reached > result.start else []
    if arguments.json:
        sys.stdout.write(json.dumps(summary(result, written), indent=2, allow_nan=False) + "\n")
    if not arguments.quiet:
        _report(result, written, arguments.output, compiled - began, ended - compiled)
    return _exit_code(result, written)


def graph(arguments: Namespace) -> int:
    """Show the structure of a model as a table, or write it as a picture or as data."""
    from hierc import graph, picture
    from hierc.compiler.diagram import diagram
    from hierc.compiler.driver import model_of
    from hierc.runtime.files import write_whole

    path = Path(arguments.output) if arguments.output else None
    if path is not None:
        _writable(path, (*picture.SUFFIXES, *graph.WRITERS))
    params = parse_params(arguments.params)
    shown = diagram(model_of(loader.read(arguments.file), arguments.experiment, params))
    if path is None:
        marks = graph.marks_for(sys.stdout.encoding)
        sys.stdout.write(graph.to_text(shown, marks, shutil.get_terminal_size((100, 24)).columns))
        return OK
    if path.suffix in graph.WRITERS:
        write_whole(path, graph.WRITERS[path.suffix](shown).encode())
    else:
        try:
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
            raise UsageError(f"-p {name}: `{value}` is not a number, `true`, `false`, or a list of them")
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
    from hierc.runtime.errors import SettingError
    from hierc.runtime.result import Interrupted, SimulationError

    settings = {name: getattr(arguments, name) for name in _SETTINGS if getattr(arguments, name) is not None}
    stop = settings.get("stop", model.plan.experiment.settings.get("stop"))
    if stop is None:
        raise UsageError(
            "how long should it run? name an experiment that has a `stop`, or give --stop SECONDS"
        )
    start = settings.get("start", model.plan.experiment.settings.get("start", 0.0))
    with Progress(model.plan.name, start, stop, shown=not arguments.quiet) as progress:
        try:
            return model.simulate(**settings, progress=progress, announce=None if arguments.quiet else say)
        except (SimulationError, Interrupted) as error:
            return error.result
        except SettingError as error:
            raise UsageError(str(error)) from error


def _check_outputs(arguments: Namespace) -> None:
    """Refuse, before a long run, what could not be written after it."""
    if arguments.output == "-" and arguments.json:
        raise UsageError("-o - and --json both want stdout; write the table to a file")
    if arguments.output and arguments.output != "-":
        _writable(Path(arguments.output), TABLES)
    if arguments.plot:
        from hierc.runtime.plotting import SUFFIXES

        _writable(Path(arguments.plot), SUFFIXES)


def _writable(path: Path, suffixes: tuple[str, ...] | None) -> None:
    if suffixes and path.suffix not in suffixes:
        raise UsageError(f"cannot write `{path}`: the name must end in {' or '.join(suffixes)}")
    if path.is_dir():
        raise UsageError(f"cannot write `{path}`: it is a folder")
    if not path.parent.is_dir():
        raise UsageError(f"cannot write `{path}`: there is no folder `{path.parent}`")


def _saves(model: Model) -> list[Path]:
    """Files the experiment saves to: a model may be a stranger's, so only names inside the current folder."""
    here = Path.cwd()
    paths = [Path(name) for name in model.plan.experiment.save]
    for path in paths:
        if not (here / path).resolve().is_relative_to(here):
            raise UsageError(
                f"the experiment saves to `{path}`, outside the current folder; write there with -o if you mean it"
            )
        _writable(path, TABLES)
    return paths


def _write(result: Result, arguments: Namespace, saves: list[Path]) -> list[str]:
    """Write all files; returns a line for each. One that fails does not lose the others."""
    written: list[str] = []
    failure: OSError | None = None
    if arguments.output == "-":
        from hierc.runtime.writers import print_csv

        print_csv(sys.stdout, result.t, result.columns())
        saves = []
    elif arguments.output:
        saves = [Path(arguments.output)]
    for path in saves:
        try:
            (result.to_csv if path.suffix == ".csv" else result.to_npz)(path)
            written.append(str(path))
        except OSError as error:
            failure = failure or OSError(error.errno, error.strerror, str(path))
    if arguments.plot:
        try:
            result.plot(arguments.plot)
        except ImportError as error:
            raise UsageError(str(error)) from None
        written.append(arguments.plot)
    if failure:
        raise failure
    return written


def summary(result: Result, written: list[str]) -> dict[str, Any]:
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
        "groups": {name: _plain(asdict(s)) for name, s in result.stats.items()},
        "files": written,
    }


def _plain(value: object) -> object:
    """JSON has no infinities and NaNs: null."""
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _report(result: Result, written: list[str], output: str | None, compiling: float, running: float) -> None:
    say(
        f"{result.model}: {result.start:g} to {result.t_reached:g} s, "
        f"simulated in {duration(running)} after {duration(compiling)} of preparation"
    )
    show_groups(result.stats)
    for name, value in result.params.items():
        say(f"set: {name} = {value}")
    for name in written:
        say(f"written: {name}")
    if not written and output is None and result.status.ok:
        say("nothing written: -o FILE keeps the results, --plot FILE draws them")


def _exit_code(result: Result, written: list[str]) -> int:
    if result.status.ok:
        return OK
    kept = f"; what was computed until then is in {' and '.join(written)}" if written else ""
    say(f"hierc: {result.status.message}{kept}")
    return INTERRUPTED if result.status.name == "INTERRUPTED" else NUMERICAL_FAILURE
