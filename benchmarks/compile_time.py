"""What compiling costs as an array of agents grows:  python benchmarks/compile_time.py [--into docs/benchmarks.md]

The platoon of the gallery with more and more cars. CPU time of each phase in a process that has compiled before, the least of several runs, and of
importing the generated module; the size of its text; and the number of Python functions that were called, which tells what is done for each car
in Python from tables that numpy fills at once.
"""

from __future__ import annotations

import argparse
import gc
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from types import FrameType
from typing import TypeVar

from document import put
from tables import markdown

from hierc.compiler.driver import compile_source
from hierc.compiler.emission.emit import emit
from hierc.compiler.emission.plan import plan
from hierc.compiler.front import analyse
from hierc.compiler.symbolic.derive import derive
from hierc.grammar.parser import parse
from hierc.loader import ModelText, read_file, run_module

T = TypeVar("T")
_MODEL = Path(__file__).parents[1] / "models" / "platoon.hier"
#: Below some dozens, sums are written out; from 100 cars on, the code is the same for any number.
_SIZES = (10, 100, 1000, 10_000, 100_000)


@dataclass(frozen=True, slots=True)
class Cost:
    """CPU seconds of parsing, of the front end (names, shapes, arrays, levels), of derivatives, of tables and text, and of an import."""

    parse: float
    front: float
    derive: float
    emit: float
    load: float

    @property
    def compile(self) -> float:
        """Everything from text to text."""
        return self.parse + self.front + self.derive + self.emit


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description="Measure compiling the platoon with more and more cars.")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--into", type=Path, help="a document whose table is to be replaced")
    options = parser.parse_args(argv)
    table = _table(read_file(_MODEL), options.repeat)
    print(table)
    if options.into:
        put(options.into, "compile", table)


def _table(text: ModelText, repeat: int) -> str:
    rows: list[list[str]] = []
    first: Cost | None = None
    for count in _SIZES:
        _compile(text, count)  # warms up
        best = _least([_measured(text, count) for _ in range(repeat)])
        first = first or best
        steps = (best.parse, best.front, best.derive, best.emit, best.compile)
        calls = _calls(partial(_compile, text, count))
        rows.append(
            [
                f"{count:,}",
                *(f"{1e3 * cost:.1f}" for cost in steps),
                f"{best.compile / first.compile:.2f}",
                f"{calls / 1e3:.0f}",
                f"{1e3 * best.load:.1f}",
                f"{len(_compile(text, count)) / 1e3:.0f}",
            ]
        )
    head = ["cars", "parse ms", "front ms", "derive ms", "emit ms", "all ms", "of that for 10 cars"]
    return markdown([*head, "1000 calls", "import ms", "text kB"], rows)


def _compile(text: ModelText, count: int) -> str:
    return compile_source(text.source, None, {"N": count}, reader=text.finder).text


def _measured(text: ModelText, count: int) -> Cost:
    gc.collect()
    times = [time.process_time()]

    def timed(value: T) -> T:
        times.append(time.process_time())
        return value

    tree = timed(parse(text.source))
    model = timed(analyse(tree, overrides={"N": count}, reader=text.finder))
    symbolic = timed(derive(model))
    module = timed(emit(plan(model, symbolic)))
    timed(run_module(module, "platoon"))
    return Cost(*(after - before for before, after in pairwise(times)))


def _least(costs: Sequence[Cost]) -> Cost:
    return min(costs, key=lambda cost: cost.compile)


def _calls(work: Callable[[], object]) -> int:
    """How many Python functions are called."""
    count = 0

    def seen(frame: FrameType, event: str, argument: object) -> None:
        nonlocal count
        count += event == "call"

    sys.setprofile(seen)
    try:
        work()
    finally:
        sys.setprofile(None)
    return count


if __name__ == "__main__":
    main()
