"""What models take in different groups, predicted and measured:  python benchmarks/groupings.py --into docs/benchmarks.md

The benchmarks' models and those of the gallery, each at rtol 1e-6. See `hierc.runtime.comparison` for which groupings are tried.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Sequence
from pathlib import Path

from document import put
from tables import markdown

import hierc
from hierc.runtime.comparison import Compared
from hierc.screen import duration

_HERE = Path(__file__).parent
_GALLERY = sorted(file for file in (_HERE.parent / "models").glob("*.hier"))
_MODELS = [*sorted((_HERE / "models").glob("*.hier")), *_GALLERY]


def main(argv: Sequence[str] | None = None) -> None:
    """Measure, print, and put the table into a document."""
    parser = argparse.ArgumentParser(description="Measure models in different groups.")
    parser.add_argument("--into", type=Path, help="a document whose table is to be replaced")
    parser.add_argument("models", nargs="*", type=Path, default=_MODELS)
    options = parser.parse_args(argv)
    rows = []
    for file in options.models:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model = hierc.load(file)
        if model.plan.experiment.settings.get("stop") is not None and len(model.plan.groups) > 1:
            rows += _rows(file.stem, model.compare_groups(rtol=1e-6))
    head = ["model", "groups", "predicted", "measured", "of the best", "which"]
    table = markdown(head, rows)
    print(table)
    if options.into:
        put(options.into, "groupings", table)


def _rows(name: str, found: Sequence[Compared]) -> list[list[str]]:
    """The named groupings of a model, and the quickest of all."""
    best = found[0].measured
    rows = []
    for k, row in enumerate(found):
        if row.kinds or k == 0:
            ratio = f"{row.measured / best:.2f}" if row.measured and best else "-"
            predicted = "-" if row.predicted is None else duration(row.predicted)
            measured = "fails" if row.measured is None else duration(row.measured)
            which = ", ".join(row.groups) if len(row.groups) < 5 else f"{len(row.groups)} kinds of groups"
            rows.append([name, ", ".join(row.kinds) or "best", predicted, measured, ratio, which])
    return rows


if __name__ == "__main__":
    main()
