"""Columns in the text of a module: each in the shortest of the contract's forms."""

from __future__ import annotations

import zlib
from base64 import b64encode

import numpy as np

from hierc.compiler.arrays.columns import Column, Index, Integers
from hierc.compiler.emission.runs import Members, Run
from hierc.compiler.emission.target import Call, Constant, Target, Tuple

#: What modules of models with arrays import from the contract.
CONSTRUCTORS = ("Defaults", "Packed", "Run", "Steps")


def index(of: Index) -> Target:
    """A column as an integer, steps, a list or packed."""
    return Constant(of) if isinstance(of, int) else column(of)


def column(of: Column) -> Target:
    """The same; a column of one element stays a column."""
    values = of.values
    steps = np.diff(values)
    if len(values) > 1 and (steps == steps[0]).all():
        return Call(
            "Steps", tuple(Constant(n) for n in (int(values[0]), int(steps[0]))[: 1 + (steps[0] != 1)])
        )
    text = packed(values)
    least, length = (
        3 * len(values),
        len(f"Packed('{text}')"),
    )  # a list takes three letters for each number, or more
    if least > length or (least > len(text) and len(str(values.tolist())) > length):
        return Call("Packed", (Constant(text),))
    return Tuple(tuple(Constant(n) for n in values.tolist()))


def packed(values: Integers) -> str:
    """Integers as base64 of their little-endian 32-bit differences (the first from 0), compressed by zlib."""
    differences = np.diff(values, prepend=0)
    if (abs(differences) >= 2**31).any():
        raise ValueError("integers beyond 32 bits cannot be packed")
    return b64encode(zlib.compress(differences.astype("<i4").tobytes())).decode("ascii")


def members(of: Members) -> Target:
    """An entry of a group."""
    if not isinstance(of, Run):
        return index(of)
    rest = (("shift", Constant(of.shift)),) if of.shift else ()
    steps = (Constant(of.step),) if of.step != 1 else ()
    return Call("Run", (Constant(of.first), Constant(of.count), *steps), rest)
