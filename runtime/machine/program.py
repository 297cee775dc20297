"""Machine code for a plan: the kernel and the steps of each method, once a machine, and the pieces of each form of group, once a content.

Objects are cached under a hash of everything they were made from: the runtime's own sources, the text of the classes' functions, the form, the
method, the processor and LLVM. What is found there needs no lowering.
"""

from __future__ import annotations

import functools
import hashlib
import inspect
import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hierc.runtime.contract import Class
from hierc.runtime.files import cache_folder, write_whole
from hierc.runtime.kernel import advance
from hierc.runtime.machine import callees, timing
from hierc.runtime.machine.allowed import check_class
from hierc.runtime.machine.calls import Form
from hierc.runtime.machine.compose import Composer
from hierc.runtime.machine.unit import Loaded, Unit, compile_object, machine_key, parse_function
from hierc.runtime.methods.catalogue import every_method
from hierc.runtime.methods.method import Method
from hierc.runtime.segments import sample

#: Called with a sentence where something has to be compiled that takes a while.
Announce = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Pieces:
    """The compiled pieces of one form under one method: addresses by name, and what `methods.method.Names` tells of them."""

    addresses: dict[str, int]
    work: int
    linear: bool
    updates: int
    entries: int


@dataclass(frozen=True, slots=True)
class Program:
    """Everything a run needs of machine code. `code` keeps it in memory. `idle`, where it has timers, tells what they cost (see `timing.py`)."""

    advance: int
    sample: int
    steps: dict[str, int]  # of the methods that are used
    pieces: dict[tuple[Form, str], Pieces]
    code: Loaded
    links: callees.Links
    idle: int | None = None


def build(
    classes: tuple[Class, ...],
    wanted: Sequence[tuple[Form, str]],
    announce: Announce | None = None,
    *,
    cache: bool = True,
    timed: bool = False,
) -> Program:
    """Compile, or take from the cache, the kernel, the steps of each method and the pieces for each (form, method); `timed`: with timers."""
    store = cache_folder("objects") if cache else None
    methods = every_method()
    common = f"{'timed ' if timed else ''}%s {runtime_digest()}"
    what = "an integration kernel with timers" if timed else "the integration kernel"
    objects = [cached(store, common % "kernel", functools.partial(_kernel, timed=timed), announce, what)]
    used = dict.fromkeys(name for _, name in wanted)
    for name in used:
        make = functools.partial(_step, methods[name], timed=timed)
        objects.append(cached(store, common % f"step of {name}", make, announce, f"the steps of {name}"))
    labels: dict[tuple[Form, str], tuple[str, dict[str, Any]]] = {}
    for form, name in dict.fromkeys(wanted):
        text = description(classes, form, name) + ("\ntimed" if timed else "")
        label = "g" + hashlib.sha256(text.encode()).hexdigest()[:16]
        make = functools.partial(_form, label, classes, form, methods[name], timed=timed)
        made = cached(store, text, make, None, "")
        labels[form, name] = (label, made[0])
        objects.append(made)
    code = Loaded([o for _, o in objects])
    links = callees.Links(code)
    for (form, _), (label, _) in labels.items():
        links.add(label, called_by(classes, form))
    pieces = {
        (form, name): Pieces(
            {p.__name__: code.address(f"{label}_{p.__name__}") for p in methods[name].pieces},
            **facts,
        )
        for (form, name), (label, facts) in labels.items()
    }
    steps = {name: code.address(f"step_{name}") for name in used}
    idle = code.address("idle") if timed else None
    return Program(code.address("advance"), code.address("sample"), steps, pieces, code, links, idle)


def _kernel(*, timed: bool = False) -> tuple[dict[str, Any], Unit]:
    unit = Unit("kernel", timed=timed)
    if timed:
        unit.lower(timing.idle, export="idle")
    unit.lower(advance, export="advance")
    unit.lower(sample, export="sample")
    return {}, unit


def _step(method: Method, *, timed: bool = False) -> tuple[dict[str, Any], Unit]:
    unit = Unit(f"step_{method.name}", timed=timed)
    unit.lower(method.step, lanes=method.lanes, constants=method.step_names(), export=f"step_{method.name}")
    return {}, unit


def _form(
    label: str, classes: tuple[Class, ...], form: Form, method: Method, *, timed: bool = False
) -> tuple[dict[str, Any], Unit]:
    unit, composer = composed(label, classes, form, method.lanes, timed=timed)
    made = method.names(composer)
    for piece in method.pieces:
        unit.lower(piece, lanes=method.lanes, constants=made.names, export=f"{label}_{piece.__name__}")
    facts = {"work": made.work, "linear": made.linear, "updates": made.updates, "entries": made.entries}
    return facts, unit


def composed(
    label: str, classes: tuple[Class, ...], form: Form, lanes: int, *, timed: bool = False
) -> tuple[Unit, Composer]:
    """A unit with what the functions of a form call, and what composes these, checked before."""
    for kind in {call.kind for call in form.calls + form.publishing}:
        check_class(classes[kind])
    unit = Unit(label, timed=timed)
    unit.callees.update(callees.emit(unit, label, called_by(classes, form)))
    return unit, Composer(unit, label, form, classes, parse_function, lanes)


def called_by(classes: tuple[Class, ...], form: Form) -> dict[str, callees.Callee]:
    """The tables and externs that the functions of a form call. Classes are of one module, so their names are those of one thing."""
    found: dict[str, callees.Callee] = {}
    for kind in sorted({call.kind for call in form.calls + form.publishing}):
        for function in _functions(classes[kind]):
            found.update(callees.called(function))
    return found


def _functions(kind: Class) -> list[Callable[..., None]]:
    """The functions of a class that become machine code."""
    return [kind.rhs, *(p.function for p in kind.parts), kind.jac]


def cached(
    store: Path | None,
    content: str,
    make: Callable[[], tuple[dict[str, Any], Unit]],
    announce: Announce | None,
    what: str,
) -> tuple[dict[str, Any], bytes]:
    """The object for this content: its facts as a line of JSON, then its code."""
    name = hashlib.sha256(f"{machine_key()}\n{content}".encode()).hexdigest()
    if store is not None:
        with suppress(
            OSError, ValueError, TypeError, KeyError, AttributeError
        ):  # a damaged file is made again
            line, code = (store / f"{name}.o").read_bytes().split(b"\n", 1)
            facts = json.loads(line)
            if facts.pop("digest") == _digest(facts, code):
                return facts, code
    if announce is not None:
        announce(f"compiling {what} for this machine (once)")
    facts, unit = make()
    code = compile_object(unit.text())
    if store is not None:
        line = json.dumps({**facts, "digest": _digest(facts, code)}).encode()
        with suppress(OSError):
            write_whole(store / f"{name}.o", line + b"\n" + code)
    return facts, code


def _digest(facts: dict[str, Any], code: bytes) -> str:
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode() + b"\n" + code).hexdigest()


def description(classes: tuple[Class, ...], form: Form, method: str) -> str:
    """Everything that decides the code of a form: the text of all functions it calls, and how they are composed."""
    used = sorted({call.kind for call in form.calls + form.publishing})
    texts = []
    for k in used:
        kind = classes[k]
        sizes = (len(kind.states), kind.inputs, kind.values, kind.outs)
        texts.append(repr((k, sizes, kind.pattern, [(p.outs, p.inputs) for p in kind.parts])))
        texts += [text_of(f) for f in _functions(kind)]
    for name, callee in called_by(classes, form).items():
        texts.append(f"{name}: {callees.description(callee)}")
    return "\n".join([runtime_digest(), method, repr(form), *texts])


@functools.cache
def text_of(function: Callable[..., Any]) -> str:
    """A function's source."""
    return inspect.getsource(function)


@functools.cache
def runtime_digest() -> str:
    """Hash of the sources that shape machine code."""
    here = Path(__file__).parent
    files = [*here.glob("*.py"), *here.parent.glob("methods/*.py")]
    files += [here.parent / f"{name}.py" for name in ("kernel", "records", "segments", "control", "linalg")]
    return hashlib.sha256(b"\0".join(f.read_bytes() for f in sorted(files))).hexdigest()
