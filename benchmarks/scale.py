"""Time and memory as arrays of agents grow:  python benchmarks/scale.py [--into docs/benchmarks.md] [--picture docs/scale.svg]

A platoon (each car reads the one in front), a star (all read one), a tree (each reads the one above it) and a crowd (all read a sum over
all) of 10 to 10,000 agents. Each is run in a process of its own, whose machine code is in the cache: CPU time of compiling, of setting the first
run up, of the kernel, and the memory that all this takes beyond what hierc takes for ten agents.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from document import put
from tables import markdown

_HERE = Path(__file__).parent
SHAPES = {
    "platoon": _HERE.parent / "models" / "platoon.hier",
    "star": _HERE / "models" / "star.hier",
    "tree": _HERE / "models" / "tree.hier",
    "crowd": _HERE / "models" / "crowd.hier",
}
SIZES = (10, 100, 1000, 10_000)
STOP = 20.0


def main(argv: Sequence[str] | None = None) -> None:
    """Measure, print and draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", type=lambda text: [int(n) for n in text.split(",")], default=SIZES)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--into", type=Path, help="a document whose table is to be replaced")
    parser.add_argument("--picture", type=Path, help="where to draw it")
    parser.add_argument("--one", nargs=2, metavar=("SHAPE", "N"), help="measure one, here; prints JSON")
    options = parser.parse_args(argv)
    if options.one:
        print(json.dumps(_measured(options.one[0], int(options.one[1]))))
        return
    found = {(shape, n): _best(shape, n, options.repeat) for shape in SHAPES for n in options.sizes}
    table = _table(found)
    print(table)
    if options.into:
        put(options.into, "scale", table)
    if options.picture:
        _draw(found, options.picture)


def _best(shape: str, n: int, repeat: int) -> dict[str, Any]:
    """The least of each figure over several processes."""
    command = [sys.executable, __file__, "--one", shape, str(n)]
    runs = [
        json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        for _ in range(repeat + 1)  # the first puts machine code into the cache
    ][1:]
    return {name: min(run[name] for run in runs) for name in runs[0]}


def _measured(shape: str, n: int) -> dict[str, Any]:
    import hierc
    from hierc.runtime.simulation import Simulation

    hierc.load(SHAPES[shape], params={"N": 10}, cache=False).simulate(STOP)
    before = _memory()
    began = time.process_time()
    model = hierc.load(SHAPES[shape], params={"N": n}, cache=False)
    compiled = time.process_time()
    spent = [0.0]
    attempt = Simulation.attempt

    def timed(*args: Any, **kwargs: Any) -> Any:
        start = time.process_time()
        try:
            return attempt(*args, **kwargs)
        finally:
            spent[0] += time.process_time() - start

    Simulation.attempt = timed  # type: ignore[method-assign]
    result = model.simulate(STOP)
    ended = time.process_time()
    return {
        "states": len(model.states),
        "compile": compiled - began,
        "setup": ended - compiled - spent[0],
        "kernel": spent[0],
        "steps": sum(f.steps for f in result.families),
        "memory": _memory() - before,
    }


def _memory() -> float:
    """The most memory that this process has had so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _table(found: dict[tuple[str, int], dict[str, Any]]) -> str:
    head = ["", "agents", "states", "compile ms", "set-up ms", "kernel ms", "steps", "ns a step", "MB"]
    return markdown(
        head,
        [
            [
                shape,
                f"{n:,}",
                f"{run['states']:,}",
                f"{1e3 * run['compile']:.0f}",
                f"{1e3 * run['setup']:.1f}",
                f"{1e3 * run['kernel']:.3g}",
                f"{run['steps']:,}",
                f"{1e9 * run['kernel'] / run['steps']:.0f}",
                f"{run['memory']:.0f}",
            ]
            for (shape, n), run in found.items()
        ],
    )


def _draw(found: dict[tuple[str, int], dict[str, Any]], picture: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    panels = (("kernel", 1e3, "kernel, CPU ms"), ("memory", 1.0, "memory, MB"))
    for axis, (name, factor, label) in zip(axes, panels, strict=True):
        for shape in SHAPES:
            own = [(n, factor * run[name]) for (s, n), run in found.items() if s == shape]
            axis.loglog(*zip(*own, strict=True), "o-", label=shape, markersize=4)
        axis.set_xlabel("agents")
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
    axes[0].legend(frameon=False)
    figure.savefig(picture)


if __name__ == "__main__":
    main()
