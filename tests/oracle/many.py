"""Tries many random models: `python tests/oracle/many.py FIRST LAST [CHECK ...]`. Prints counts, and a reduced text for each problem."""

from __future__ import annotations

import sys
import warnings
from collections import Counter
from contextlib import suppress
from pathlib import Path
from random import Random

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "runtime")]

from checks import ALWAYS, SOME, attempt, reduced  # noqa: E402
from making.models import Wishes, random_model  # noqa: E402


def main(first: int, last: int, names: tuple[str, ...]) -> int:
    """The number of problems found; Ctrl-C ends it early."""
    warnings.simplefilter("ignore")
    counts: Counter[str] = Counter()
    with suppress(KeyboardInterrupt):
        for seed in range(first, last):
            block = random_model(
                Random(seed), Wishes(arrays=seed % 2 == 1, outside=seed % 3 == 1, groups=seed % 5 < 3)
            )
            problem = attempt(block, seed, names)
            kind = "agree" if problem is None else type(problem).__name__
            counts[kind] += 1
            if problem is not None and counts[kind] <= 5:
                print(f"---- seed {seed}: {kind}: {str(problem)[:500]}")
                print(reduced(block, seed, names, type(problem)).text(), flush=True)
    print(dict(counts))
    return counts.total() - counts["agree"]


if __name__ == "__main__":
    sys.exit(bool(main(int(sys.argv[1]), int(sys.argv[2]), tuple(sys.argv[3:]) or (*ALWAYS, *SOME))))
