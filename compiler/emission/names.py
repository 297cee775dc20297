"""Names in generated modules.

In: agents' names. Out: Python names. Guaranteed: different classes get different names; a function's name ends with the role it plays, so
that none is a keyword, a builtin, a dunder or one of the module's own tables.
"""

from __future__ import annotations

import re
from collections.abc import Iterable


def class_names(templates: Iterable[str]) -> tuple[str, ...]:
    """A name for each class, from its agent's: `Agent.level` is `Agent_level`; the second class of an agent is `Agent_2`."""
    names: dict[str, None] = {}
    for template in templates:
        base = re.sub(r"[^A-Za-z0-9_]", "_", template)
        base = base if re.match(r"[A-Za-z_]", base) else f"_{base}"
        name, k = base, 1
        while name in names:
            k += 1
            name = f"{base}_{k}"
        names[name] = None
    return tuple(names)


def function_name(class_name: str, role: str) -> str:
    """The function of a class for a role: letters and digits without underscores, so that names cannot meet."""
    return f"{class_name}_{role}"


def callee_name(index: int) -> str:
    """What a table or external function is called in the module: no class has a name without an underscore."""
    return f"callee{index}"
