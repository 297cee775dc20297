"""Random functions as the compiler writes them: assignments and branches over arithmetic that stays finite."""

from __future__ import annotations

import random


def random_function(seed: int) -> str:
    """rhs(t, x, u, p, dx) with two states, an input and two values, that sets six entries of dx."""
    rng = random.Random(seed)
    names = ["t", "x[0]", "x[1]", "u[0]", "p[0]", "p[1]"]
    lines = ["def rhs(t, x, u, p, dx):", *statements(rng, names, 2, 6, "    ")]
    lines += [f"    dx[{k}] = {name}" for k, name in enumerate(names[-6:])]
    return "\n".join(lines)


def expression(rng: random.Random, names: list[str], depth: int) -> str:
    """A random number-valued expression that stays within every function's domain."""
    if depth == 0 or rng.random() < 0.1:
        return rng.choice([*names, repr(rng.uniform(-3, 3)), repr(float(rng.randint(-3, 3)))])

    def more() -> str:
        return expression(rng, names, depth - 1)

    return rng.choice(
        [
            lambda: f"({more()} + {more()})",
            lambda: f"({more()} - {more()})",
            lambda: f"{more()}*{more()}*0.25",
            lambda: f"{more()}/(1.5 + math.fabs({more()}))",
            lambda: f"-({more()})",
            lambda: f"math.sqrt(math.fabs({more()}))",
            lambda: f"math.atan2({more()}, {more()})",
            lambda: f"math.tanh({more()})",
            lambda: f"float(math.floor({more()}))",
            lambda: f"math.copysign({more()}, {more()})",
            lambda: f"max({more()}, {more()})",
            lambda: f"min({more()}, {more()})",
            lambda: f"abs({more()})",
            lambda: f"({more()} if {condition(rng, names, depth - 1)} else {more()})",
        ]
    )()


def condition(rng: random.Random, names: list[str], depth: int) -> str:
    """A random truth-valued expression."""
    if depth <= 0 or rng.random() < 0.5:
        a, b = (expression(rng, names, max(depth - 1, 0)) for _ in range(2))
        return f"({a} {rng.choice(['<', '<=', '>', '>=', '==', '!='])} {b})"
    a, b = (condition(rng, names, depth - 1) for _ in range(2))
    return rng.choice([f"({a} and {b})", f"({a} or {b})", f"(not {a})"])


def statements(rng: random.Random, names: list[str], depth: int, count: int, indent: str) -> list[str]:
    """Assignments and branches; what they define is added to `names`."""
    lines = []
    for _ in range(count):
        name = f"a{rng.getrandbits(40)}"
        if depth > 0 and rng.random() < 0.5:
            lines.append(f"{indent}if {condition(rng, names, 2)}:")
            for orelse in (False, True):
                if orelse:
                    lines.append(f"{indent}else:")
                inner = list(names)
                lines += statements(rng, inner, depth - 1, 2, indent + "    ")
                lines.append(f"{indent}    {name} = {expression(rng, inner, 2)}")
        else:
            lines.append(f"{indent}{name} = {expression(rng, names, 2)}")
        names.append(name)
    return lines
