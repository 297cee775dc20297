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
from pathlib import Path

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
    try:
        from hierc import (
            commands,
        )  # not before the arguments are right: `--help` and `--version` answer at once

        code = getattr(commands, arguments.command)(arguments)
        sys.stdout.flush()
        return int(code)
    except KeyboardInterrupt:
        say("hierc: interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        # What is left in the buffer must not be flushed into the closed pipe when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        say("hierc: nobody reads the output any more")
        return USAGE
    except Exception as error:
        return _failed(error, arguments)


def _failed(error: Exception, arguments: argparse.Namespace) -> int:
    from hierc.grammar.problems import ModelError

    match error:
        case UsageError():
            say(f"hierc: error: {error}")
            return USAGE
        case ModelError():
            show_problems(error.problems, as_json=getattr(arguments, "json", False))
            return MODEL_ERROR
        case OSError():
            where = f"`{error.filename}`: " if error.filename else ""
            say(f"hierc: error: {where}{error.strerror or error}")
            return USAGE
        case MemoryError():
            say("hierc: error: there is not enough memory for this")
            return USAGE
        case _:
            _bug(error)
            return BUG


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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="hierc",
        description="Compile and simulate hierarchical models.",
        epilog=_EXIT_CODES,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"hierc {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    file = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    file.add_argument(
        "file", metavar="FILE", help="a .hier file, or the name of a packaged model such as `cart`"
    )
    chosen = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    chosen.add_argument("experiment", metavar="EXPERIMENT", nargs="?", help="needed if the file has several")
    chosen.add_argument(
        "-p",
        dest="params",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="replace a parameter, as in -p cart.kv=60",
    )
    report = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    report.add_argument(
        "--json", action="store_true", help="print a summary, or the problems, as JSON on stdout"
    )

    units = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
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
    translate = commands.add_parser(
        "compile",
        parents=[file, chosen, units],
        help="write the model as a Python module",
        allow_abbrev=False,
    )
    translate.add_argument("-o", dest="output", metavar="FILE.py", help="where to write it; otherwise stdout")
    translate.add_argument(
        "--emit", choices=STAGES, default="python", help="print what a phase of the compiler made"
    )
    graph = commands.add_parser(
        "graph", parents=[file, chosen], help="show groups and who reads what", allow_abbrev=False
    )
    graph.add_argument(
        "-o", dest="output", metavar="FILE", help="write .svg, .png, .pdf, .dot or .json instead of a table"
    )
    page = commands.add_parser("explain", help="explain the code of a problem", allow_abbrev=False)
    page.add_argument(
        "code", metavar="CODE", nargs="?", help="such as E601; without it, all codes are listed"
    )
    _add_fmt_options(commands.add_parser("fmt", help="lay out model files in one style", allow_abbrev=False))
    return parser


def _add_fmt_options(fmt: argparse.ArgumentParser) -> None:
    fmt.add_argument(
        "paths", metavar="PATH", nargs="+", help="a file, a folder of .hier files, or - for stdin"
    )
    fmt.add_argument("--check", action="store_true", help="write nothing; exit with 1 if a file would change")
    fmt.add_argument("--diff", action="store_true", help="write nothing; print what would change")
    fmt.add_argument("--width", type=int, default=100, metavar="COLUMNS", help="of a line; default 100")


def _add_run_options(run: argparse.ArgumentParser) -> None:
    seconds = {"type": float, "metavar": "SECONDS"}
    run.add_argument("--start", **seconds, help="default 0")  # type: ignore[arg-type]
    run.add_argument("--stop", **seconds, help="default: the experiment's")  # type: ignore[arg-type]
    run.add_argument("--interval", **seconds, help="between output times; default: 500 parts of the run")  # type: ignore[arg-type]
    run.add_argument("--rtol", type=float, metavar="NUMBER", help="relative tolerance")
    run.add_argument(
        "--atol", type=float, metavar="NUMBER", help="absolute tolerance, times the nominal of each state"
    )
    run.add_argument("--method", metavar="NAME", help="one method for all groups")
    run.add_argument(
        "-o",
        dest="output",
        metavar="FILE",
        help="write .csv or .npz, instead of what the experiment saves; - is stdout",
    )
    run.add_argument("--plot", metavar="FILE", help="draw to .png, .pdf or .svg")
    run.add_argument("--quiet", action="store_true", help="say nothing unless something is wrong")
