"""From Python text to machine code.

A small subset of Python (floats, integers, fixed-width lanes, arrays, records, loops, branches) is parsed with `ast` and lowered to LLVM. Three
kinds of text take this way: the functions of a generated module, the inner pieces of the integration methods, and the kernel that schedules
them. All of it is importable Python, so that CPython with numpy is the oracle of what the machine code must compute.

    dialect.py     the subset's types and built-in functions, as Python sees them
    lower.py       statements and expressions to LLVM
    loops.py       loops to LLVM
    matrices.py    systems of equations to LLVM
    builtins.py    built-in functions to LLVM
    vectormath.py  sin, cos, exp over lanes
    split.py       what of a right-hand side depends on inputs and time only
    linear.py      straight-line sparse LU over complex lanes
    compose.py     the functions of a group from those of its nodes
    unit.py        optimised, cached object code
"""
