"""Writers of results: CSV and NPZ files.

A file is whole or not there. Names come from models and may be hostile to the programs that read the file; numbers are written so that
reading them gives the same bits.
"""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO, TextIO

import numpy as np
from numpy.typing import NDArray

from hierc.runtime.files import write_whole

Floats = NDArray[np.float64]

#: Numbers formatted at a time, about.
_BLOCK = 1 << 18


def write_csv(path: Path, t: Floats, columns: Mapping[str, Floats]) -> None:
    """Write `time` and the columns as CSV (RFC 4180 with plain line feeds), floats by `repr`."""

    def put(file: BinaryIO) -> None:
        text = io.TextIOWrapper(file, encoding="utf-8", newline="")
        print_csv(text, t, columns)
        text.detach()

    write_whole(path, put)


def print_csv(file: TextIO, t: Floats, columns: Mapping[str, Floats]) -> None:
    """Write the same table to an open text file."""
    csv.writer(file, lineterminator="\n").writerow(["time", *map(safe_cell, columns)])
    for rows in _rows(t, columns):
        file.writelines(",".join(map(repr, row)) + "\n" for row in rows)
    file.flush()


def _rows(t: Floats, columns: Mapping[str, Floats]) -> Iterator[list[list[float]]]:
    table = np.column_stack([t, *columns.values()])
    count = max(_BLOCK // table.shape[1], 1)
    for first in range(0, len(table), count):
        yield table[first : first + count].tolist()  # Python floats, not numpy's


def safe_cell(name: str) -> str:
    """A name no spreadsheet takes for a formula and no terminal for a control sequence."""
    shown = "".join(c if c.isprintable() else repr(c)[1:-1] for c in name)
    return f"'{shown}" if shown.startswith(("=", "+", "-", "@")) else shown


def write_npz(path: Path, t: Floats, arrays: Mapping[str, Floats]) -> None:
    """Write `time` and the arrays for `numpy.load`; the same run gives the same bytes, and nothing in it is pickled."""

    def put(file: BinaryIO) -> None:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for name, array in {"time": t, **arrays}.items():
                member = zipfile.ZipInfo(f"{name}.npy")  # its date is fixed
                member.compress_type = zipfile.ZIP_DEFLATED
                with archive.open(member, "w", force_zip64=True) as entry:
                    np.lib.format.write_array(entry, np.ascontiguousarray(array), allow_pickle=False)

    write_whole(path, put)
