"""hierc beside other solvers, at equal achieved error:  python benchmarks/compare.py --problems cart

    --peers scipy,sunC,diffrax --peers-dir DIR --peers-python DIR/bin/python     measure peers in the same session
    --problems-dir DIR                                                           check references against ready ones

Runs of hierc and of the peers alternate, and least times count, so that a change in the machine's speed meets all alike. Writes
`<problem>.md` and `<problem>.json` to the folder `--out`.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import machine
import tables
from cases import CASES, Case
from document import put
from measure import Collected, Run, sweep
from peers import Peers
from reference import Reference, reference

from hierc.runtime.methods.catalogue import METHODS

#: Two a decade, the same for everybody.
_TOLERANCES = "1e-2,3e-3,1e-3,3e-4,1e-4,3e-5,1e-5,3e-6,1e-6,3e-7,1e-7,3e-8,1e-8,3e-9,1e-9,1e-10"


def main(argv: Sequence[str] | None = None) -> None:
    """Measure, print and write tables."""
    parser = _parser()
    options = parser.parse_args(argv)
    if options.peers and not (options.peers_dir and options.peers_python and options.problems_dir):
        parser.error("--peers needs --peers-dir, --peers-python and --problems-dir")
    options.out.mkdir(parents=True, exist_ok=True)
    peers = (
        Peers(options.peers_dir.resolve(), options.peers_python.absolute(), options.limit)
        if options.peers
        else None
    )
    about = machine.description() | ({"peers": _listed(peers.versions())} if peers else {})
    for name in options.problems:
        case = CASES[name]
        solution = reference(case, options.problems_dir)
        runs = _measure(case, solution, options, peers)
        text = _report(case, runs, options.errors)
        print(text)
        if options.into:
            put(options.into, name, text)
        (options.out / f"{name}.md").write_text(f"{text}\n\n#### All runs\n\n{tables.every_run(runs)}\n")
        record = {"machine": about, "agreement": solution.agreement, "runs": [asdict(run) for run in runs]}
        (options.out / f"{name}.json").write_text(json.dumps(record, indent=1))
    described = "\n".join(f"* {key}: {value}" for key, value in about.items())
    print(described)
    if options.into:
        put(options.into, "machine", described)


def _measure(
    case: Case, solution: Reference, options: argparse.Namespace, peers: Peers | None
) -> tuple[Run, ...]:
    """All runs of a problem: hierc's before, between and after those of the peers."""
    model = case.load()
    collected = Collected()
    for _ in range(options.rounds):
        for peer in options.peers if peers and case.peer_name else ():
            collected.add(sweep(case, model, options.methods, options.tolerances, solution))
            print(f"{case.name}: measuring {peer}", file=sys.stderr)
            if peers:
                collected.add(peers.run(peer, case, options.tolerances))
        collected.add(sweep(case, model, options.methods, options.tolerances, solution))
    return collected.runs


def _report(case: Case, runs: Sequence[Run], targets: Sequence[float]) -> str:
    return "\n\n".join(
        [f"### {case.name}: {case.title}", tables.equal_error(runs, targets), tables.work(runs, targets)]
    )


def _listed(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {version}" for name, version in sorted(versions.items()))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description="Measure hierc beside other solvers at equal achieved error."
    )
    names = ",".join(CASES)
    parser.add_argument("--problems", type=_names, default=_names(names), help=f"of {names}")
    parser.add_argument("--methods", type=_names, default=["auto", *METHODS])
    parser.add_argument("--tolerances", type=_numbers, default=_numbers(_TOLERANCES))
    parser.add_argument(
        "--errors", type=_numbers, default=_numbers("1e-3,1e-5,1e-7"), help="achieved errors to compare at"
    )
    parser.add_argument("--rounds", type=int, default=3, help="how often everything is measured")
    parser.add_argument("--out", type=Path, default=Path("build/benchmarks"), help="folder of the results")
    parser.add_argument("--peers", type=_names, default=[], help="which peers, separated by commas")
    parser.add_argument("--peers-dir", type=Path, help="folder that holds run_peers.py")
    parser.add_argument("--peers-python", type=Path, help="interpreter of the environment that has the peers")
    parser.add_argument("--limit", type=float, default=600, help="s that one peer may take on one problem")
    parser.add_argument(
        "--problems-dir", type=Path, help="folder of ready reference solutions, ref/<problem>.npz"
    )
    parser.add_argument("--into", type=Path, help="a document whose tables are to be replaced")
    return parser


def _names(text: str) -> list[str]:
    return text.split(",")


def _numbers(text: str) -> list[float]:
    return [float(number) for number in text.split(",")]


if __name__ == "__main__":
    main()
