"""Tables in Markdown: what each solver needs for an achieved error.

A cell shows the cheapest run whose error is at most the target: no interpolation between tolerances, which would flatter whoever has runs
far apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from measure import Run

#: Groups whose evaluations are told one by one.
_SHOWN = 6


def cheapest(runs: Iterable[Run], target: float) -> Run | None:
    """The run with least CPU time among those with an error of at most `target`."""
    return min((run for run in runs if run.error <= target), key=lambda run: run.cpu, default=None)


def equal_error(runs: Sequence[Run], targets: Sequence[float]) -> str:
    """CPU times in ms at achieved errors, one row a solver and method, and how hierc compares with the best peer."""
    ours = [run for run in runs if run.solver == "hierc"]
    peers = [run for run in runs if run.solver != "hierc"]
    rows = [_row(f"**hierc, {m}**", _of(ours, m), targets) for m in _methods(ours)]
    rows += [_row(m, _of(peers, m), targets) for m in _methods(peers)]
    default = _of(ours, "auto")
    if peers and default:
        rows.append(["best peer / hierc, auto", *(_ratio(peers, default, t, kernel=False) for t in targets)])
        rows.append(
            ["best peer / its kernel alone", *(_ratio(peers, default, t, kernel=True) for t in targets)]
        )
    return markdown(["CPU ms at error", *(f"{t:.0e}" for t in targets)], rows)


def work(runs: Sequence[Run], targets: Sequence[float]) -> str:
    """Evaluations behind the cells of `equal_error`: of each group, or of the whole system."""
    ours = [run for run in runs if run.solver == "hierc"]
    peers = [run for run in runs if run.solver != "hierc"]
    rows = []
    for label, chosen in [("hierc, auto", _of(ours, "auto")), *((m, _of(peers, m)) for m in _methods(peers))]:
        found = [cheapest(chosen, t) for t in targets]
        rows.append([label, *("-" if run is None else _sum(run.evaluations) for run in found)])
    return markdown(["evaluations at error", *(f"{t:.0e}" for t in targets)], rows)


def _sum(counts: Sequence[int]) -> str:
    """Of each group; of many, all together."""
    return " + ".join(map(str, counts)) if len(counts) <= _SHOWN else f"{sum(counts)} in {len(counts)} groups"


def every_run(runs: Sequence[Run]) -> str:
    """All runs with tolerance, error and times."""
    rows = [
        [
            f"{run.solver} {run.method}" if run.solver == "hierc" else run.method,
            f"{run.tolerance:.0e}", f"{run.error:.1e}", milliseconds(run.cpu),
            "" if run.kernel is None else milliseconds(run.kernel), " ".join(map(str, run.steps)),
        ]
        for run in runs
    ]  # fmt: skip
    return markdown(["solver", "tolerance", "error", "CPU ms", "kernel ms", "steps"], rows)


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; the first column is text, the others are numbers."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def milliseconds(seconds: float) -> str:
    """Three digits."""
    return f"{1e3 * seconds:#.3g}".rstrip(".")


def _row(label: str, runs: Sequence[Run], targets: Sequence[float]) -> list[str]:
    return [label, *(_cell(cheapest(runs, target)) for target in targets)]


def _cell(run: Run | None) -> str:
    if run is None:
        return "-"
    kernel = "" if run.kernel is None else f" ({milliseconds(run.kernel)})"
    return milliseconds(run.cpu) + kernel


def _ratio(peers: Sequence[Run], ours: Sequence[Run], target: float, *, kernel: bool) -> str:
    peer, own = cheapest(peers, target), cheapest(ours, target)
    if peer is None or own is None:
        return "-"
    seconds = own.kernel if kernel and own.kernel is not None else own.cpu
    return f"{peer.cpu / seconds:.1f}"


def _methods(runs: Iterable[Run]) -> list[str]:
    return list(dict.fromkeys(run.method for run in runs))


def _of(runs: Iterable[Run], method: str) -> list[Run]:
    return [run for run in runs if run.method == method]
