"""The command line: arguments, exit codes, and one place where everything that can go wrong becomes a message.

stdout carries results, and only those asked for; all talk is on stderr. Exit codes: 0 done, 1 the model has errors, 2 wrong usage or a file
that cannot be written, 3 numerical failure (partial results are kept), 130 interrupted (partial results are kept), 70 a bug of hierc.
"""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from collections.abc import Sequence
from io import BytesIO, TextIOWrapper
from pathlib import Path
from typing import NoReturn, TextIO

from hierc.exits import BUG, INTERRUPTED, MODEL_ERROR, USAGE, UsageError
from hierc.screen import say, show_problems
from hierc.version import __version__

STAGES = ("ast", "model", "cascade", "symbolic", "plan", "python")

_EXIT_CODES = (
    "exit codes: 0 done, 1 the model has errors, 2 wrong usage or files, 3 numerical failure, 130 interrupted; "
    "after 3 and 130 the results so far are kept"
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code. Never raises, except SystemExit from the argument parser."""
    arguments = _parser().parse_args(argv)
    # A stream that is closed from the beginning is None, and `print` would take the other one.
    sys.stdout, sys.stderr = sys.stdout or _nowhere(), sys.stderr or _nowhere()
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # what a terminal cannot show is spelt out
    try:
        code = _told(arguments)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        say("hierc: interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        _give_up_stdout()
        say("hierc: nobody reads the output any more")
        return USAGE
    except OSError as error:
        where = f"`{error.filename}`: " if error.filename else ""
        _give_up_stdout()
        say(f"hierc: error: {where}{error.strerror or error}")
        return USAGE


def _nowhere() -> TextIO:
    return TextIOWrapper(BytesIO(), encoding="utf-8")


def _told(arguments: argparse.Namespace) -> int:
    """Run the command. What goes wrong in it is told, on stdout if as JSON; only OSError comes through, as that may fail itself."""
    from hierc.grammar.problems import ModelError

    try:
        # Not before the arguments are right: `--help` and `--version` answer at once.
        from hierc import commands

        return int(getattr(commands, arguments.command)(arguments))
    except UsageError as error:
        say(f"hierc: error: {error}")
        return USAGE
    except ModelError as error:
        show_problems(error.problems, as_json=getattr(arguments, "json", False))
        return MODEL_ERROR
    except OSError:
        raise
    except MemoryError:
        say("hierc: error: there is not enough memory for this")
        return USAGE
    except Exception as error:
        _bug(error)
        return BUG


def _give_up_stdout() -> None:
    """Where stdout takes nothing, what is left in its buffer must not be tried again when Python ends."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _bug(error: Exception) -> None:
    """Own up to a failure that no model should be able to cause."""
    if os.environ.get("HIERC_DEBUG"):
        traceback.print_exception(error, file=sys.stderr)
    frames = traceback.extract_tb(error.__traceback__)
    place = f" at {Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else ""
    say(
        f"hierc: internal error: {type(error).__name__}{place}: {' '.join(str(error).split()) or 'no message'}\n"
        f"This is a bug in hierc {__version__}, not in your model. Please report it with the model and this message;\n"
        "HIERC_DEBUG=1 in the environment shows where it happened."
    )


class _Parser(argparse.ArgumentParser):
    """A parser that says in one line what is wrong."""

    def error(self, message: str) -> NoReturn:
        say(f"{self.prog}: error: {message} (see {self.prog} --help)")
        raise SystemExit(USAGE)


class _Once(argparse.Action):
    """An option that may be given once: two names for one output are a mistake."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: object,
        option_string: str | None = None,
    ) -> None:
        if getattr(namespace, self.dest) is not None:
            raise argparse.ArgumentError(self, "given twice")
        setattr(namespace, self.dest, values)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"`{text}` is not a number, such as 0.5 or 1e-3") from None


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="hierc",
        description="Compile and simulate hierarchical models.",
        epilog=_EXIT_CODES,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"hierc {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    file = _Parser(add_help=False, allow_abbrev=False)
    file.add_argument(
        "file", metavar="FILE", help="a .hier file, or the name of a packaged model such as `cart`"
    )
    chosen = _Parser(add_help=False, allow_abbrev=False)
    chosen.add_argument("experiment", metavar="EXPERIMENT", nargs="?", help="needed if the file has several")
    chosen.add_argument(
        "-p",
        dest="params",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="replace a parameter, as in -p cart.kv=60",
    )
    report = _Parser(add_help=False, allow_abbrev=False)
    report.add_argument(
        "--json", action="store_true", help="print a summary, or the problems, as JSON on stdout"
    )

    units = _Parser(add_help=False, allow_abbrev=False)
    units.add_argument(
        "--units",
        choices=("gradual", "strict"),
        default="gradual",
        help="strict: no number but 0 goes without a unit beside one",
    )

    run = commands.add_parser(
        "run", parents=[file, chosen, units, report], help="simulate an experiment", allow_abbrev=False
    )
    _add_run_options(run)
    commands.add_parser(
        "check", parents=[file, units, report], help="report what is wrong with a model", allow_abbrev=False
    )
    commands.add_parser(
        "params",
        parents=[file, chosen, report],
        help="list parameters with their values and units",
        allow_abbrev=False,
    )
    translate = commands.add_parser(
        "compile",
        parents=[file, chosen, units],
        help="write the model as a Python module",
        allow_abbrev=False,
    )
    _add_compile_options(translate)
    graph = commands.add_parser(
        "graph", parents=[file, chosen], help="show groups and who reads what", allow_abbrev=False
    )
    graph.add_argument(
        "-o",
        dest="output",
        metavar="FILE",
        action=_Once,
        help="write .svg, .png, .pdf, .dot or .json instead of a table",
    )
    bench = commands.add_parser(
        "bench",
        parents=[file, chosen, report],
        help="compare with other solvers at equal achieved error",
        allow_abbrev=False,
    )
    _add_bench_options(bench)
    page = commands.add_parser("explain", help="explain the code of a problem", allow_abbrev=False)
    page.add_argument(
        "code", metavar="CODE", nargs="?", help="such as E601; without it, all codes are listed"
    )
    _add_fmt_options(commands.add_parser("fmt", help="lay out model files in one style", allow_abbrev=False))
    return parser


def _add_compile_options(translate: argparse.ArgumentParser) -> None:
    translate.add_argument(
        "-o", dest="output", metavar="FILE.py", action=_Once, help="where to write it; otherwise stdout"
    )
    translate.add_argument(
        "--emit", choices=STAGES, default="python", help="print what a phase of the compiler made"
    )


def _add_fmt_options(fmt: argparse.ArgumentParser) -> None:
    fmt.add_argument(
        "paths", metavar="PATH", nargs="+", help="a file, a folder of .hier files, or - for stdin"
    )
    fmt.add_argument("--check", action="store_true", help="write nothing; exit with 1 if a file would change")
    fmt.add_argument("--diff", action="store_true", help="write nothing; print what would change")
    fmt.add_argument("--width", type=int, default=100, metavar="COLUMNS", help="of a line; default 100")


def _add_bench_options(bench: argparse.ArgumentParser) -> None:
    seconds = {"type": _number, "metavar": "SECONDS"}
    bench.add_argument("--start", **seconds, help="default 0")  # type: ignore[arg-type]
    bench.add_argument("--stop", **seconds, help="default: the experiment's")  # type: ignore[arg-type]
    bench.add_argument("--max-step", **seconds, help="default: none")  # type: ignore[arg-type]
    bench.add_argument(
        "--tolerances",
        type=_tolerances,
        metavar="LIST",
        help="relative and absolute, separated by commas; default 1e-2,1e-3,...,1e-10",
    )
    bench.add_argument(
        "--time-limit", type=_number, metavar="SECONDS", default=60.0, help="of a single run; default 60"
    )
    bench.add_argument(
        "-o", dest="output", metavar="FILE", action=_Once, help="draw time over error to .png, .pdf or .svg"
    )


def _tolerances(text: str) -> tuple[float, ...]:
    found = tuple(map(_number, text.split(",")))
    if not all(1e-14 <= tolerance < 1.0 for tolerance in found):
        raise argparse.ArgumentTypeError(f"tolerances are at least 1e-14 and below 1, not `{text}`")
    return found


def _add_run_options(run: argparse.ArgumentParser) -> None:
    seconds = {"type": _number, "metavar": "SECONDS"}
    run.add_argument("--start", **seconds, help="default 0")  # type: ignore[arg-type]
    run.add_argument("--stop", **seconds, help="default: the experiment's")  # type: ignore[arg-type]
    run.add_argument("--interval", **seconds, help="between output times; default: 500 parts of the run")  # type: ignore[arg-type]
    run.add_argument("--rtol", type=_number, metavar="NUMBER", help="relative tolerance")
    run.add_argument(
        "--atol", type=_number, metavar="NUMBER", help="absolute tolerance, times the nominal of each state"
    )
    run.add_argument("--max-step", **seconds, help="of any group; default: none")  # type: ignore[arg-type]
    run.add_argument("--method", metavar="NAME", help="one method for all groups")
    run.add_argument(
        "--group",
        metavar="KIND",
        help="level: as written (default); auto: joined where that is predicted to cost less; agent: each by itself; one: all together",
    )
    run.add_argument(
        "--compare",
        action="store_true",
        help="measure what the run takes in different groups, print a table, and write nothing else",
    )
    run.add_argument(
        "-o",
        dest="output",
        metavar="FILE",
        action="append",
        default=[],
        help="write .csv or .npz, instead of what the experiment saves; - is stdout; may be given several times",
    )
    run.add_argument(
        "--plot",
        metavar="FILE",
        action="append",
        default=[],
        help="draw to .png, .pdf or .svg; may be given several times",
    )
    run.add_argument(
        "--threads",
        type=int,
        metavar="N",
        help="run blocks of groups in threads, for thousands of groups; default 1",
    )
    run.add_argument(
        "--verify", action="store_true", help="run again ten times tighter and tell the error of each group"
    )
    run.add_argument(
        "--costs",
        action="store_true",
        help="run again with timers and tell where the time of each group goes",
    )
    run.add_argument("--quiet", action="store_true", help="say nothing unless something is wrong")
