"""A model's parameters as a table: names, values as they stand, units, what they are."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from hierc.screen import aligned, plain

if TYPE_CHECKING:
    from hierc.runtime.model import Model

_BUILT_IN = "(built into the code)"
#: Digits that are shown, so that 0.7 in another unit and back is 0.7 again.
_DIGITS = 12


def listed(model: Model) -> list[dict[str, Any]]:
    """All parameters as plain data, in the order of the text; values are in `unit`."""
    types = {"real": float, "int": int, "bool": bool}
    return [
        {
            "name": path,
            "value": np.asarray(p.value).astype(types[p.kind]).tolist(),
            "unit": p.unit,
            "type": p.kind,
            "structural": p.structural,
            "doc": p.doc,
        }
        | ({"agents": p.shown} if p.shown != path else {})
        for path, p in model.parameters.items()
    ]


def table(model: Model) -> str:
    """The same for a reader; values are written as `-p` takes them."""
    ranks = {name: len(p.shape) for name, p in model.parameters.items()}
    rows = [
        (p.get("agents", p["name"]), _value(p, ranks[p["name"]]), p["unit"] or "", " ".join(_remarks(p)))
        for p in listed(model)
    ]
    experiment = model.plan.experiment.name
    head = f"{model.plan.name} ({model.plan.source})" + (f", experiment {experiment}" if experiment else "")
    if not rows:
        return plain(f"{head}: no parameters\n")
    lines = aligned([("parameter", "value", "unit", ""), *rows], left=4)
    count = "1 parameter" if len(rows) == 1 else f"{len(rows)} parameters"
    return plain("\n".join([f"{head}: {count}", "", *(f"  {line}" for line in lines), ""]))


def _remarks(parameter: dict[str, Any]) -> list[str]:
    doc = [parameter["doc"].partition("\n")[0]] if parameter["doc"] else []
    return doc + ([_BUILT_IN] if parameter["structural"] else [])


def _value(parameter: dict[str, Any], rank: int) -> str:
    """A parameter's value; of an array of agents what all have, or else the least and the greatest."""
    values = np.asarray(parameter["value"])
    if "agents" not in parameter or values.ndim == rank:
        return _shown(parameter["value"])
    rows = values.reshape(-1, *values.shape[values.ndim - rank :])
    if (rows == rows[0]).all():
        return _shown(rows[0].tolist())
    return " .. ".join(_shown(end.tolist()) for end in (rows.min(axis=0), rows.max(axis=0)))


def _shown(value: object) -> str:
    match value:
        case list():
            return f"[{', '.join(map(_shown, value))}]"
        case float():
            return f"{value:.{_DIGITS}g}"
        case _:
            return json.dumps(value)
