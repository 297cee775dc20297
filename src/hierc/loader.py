"""From a model's text to a runnable model, by way of the generated module and its cache.

What is compiled is kept in a folder that only the user may write, under a hash of everything it was made from: hierc's version and the
compiler's own sources, the texts of all files of the model, the experiment, and the values of structural parameters. When nothing of that has
changed, neither lark nor sympy is imported. Two processes may share the folder: files appear whole, and whoever comes second replaces like with like.
"""

from __future__ import annotations

import builtins
import hashlib
import importlib.util
import json
import linecache
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast

from hierc.finder import Finder, Seen, unchanged
from hierc.runtime.errors import ExternError, SettingError
from hierc.runtime.files import cache_folder, write_whole
from hierc.version import __version__

if TYPE_CHECKING:
    from hierc.grammar.source import SourceFile
    from hierc.runtime.model import Model

#: A parameter's value: a number, or rows of numbers.
Value = Any
#: Cached files kept; the oldest go first.
_KEPT = 400


@dataclass(frozen=True, slots=True)
class ModelText:
    """A model's main file, and what finds the files that it imports."""

    source: SourceFile
    finder: Finder


@dataclass(frozen=True, slots=True)
class Warned:
    """A warning of the compiler: for a reader, and as plain data with its place."""

    text: str
    data: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Loaded:
    """A runnable model, the compiler's warnings, and whether it was compiled just now."""

    model: Model
    warnings: tuple[Warned, ...]
    compiled: bool


def load(
    source: str | Path,
    experiment: str | None = None,
    params: Mapping[str, Value] | None = None,
    *,
    cache: bool = True,
    strict_units: bool = False,
) -> Model:
    """Compile a model, or take it from the cache, ready to `simulate`.

    `source` is a path, the name of a packaged model (`"cart"`), or the text of a model (a `str` with a `{` in it), which imports files as if
    it stood in the current folder. `params` replaces
    parameters by path, structural ones included, in their declared units; the others become defaults that `simulate` may replace again.
    `cache=False` compiles afresh. `strict_units`: no plain number but 0 takes its neighbour's unit. Raises
    `hierc.ModelError` with all problems, ValueError for parameters that do not fit.
    """
    import warnings

    loaded = prepare(read(source), experiment, params or {}, cache=cache, strict_units=strict_units)
    for warned in loaded.warnings:
        warnings.warn(warned.text, stacklevel=2)
    return loaded.model


def compile(
    source: str | Path, experiment: str | None = None, params: Mapping[str, Value] | None = None
) -> str:
    """The text of the Python module that a model compiles to. Arguments and errors as for `load`."""
    from hierc.compiler.driver import compile_source

    text = read(source)
    return compile_source(text.source, experiment, params or {}, reader=text.finder).text


def read(source: str | Path) -> ModelText:
    """The model that `source` names or holds; see `load`. Raises `hierc.ModelError` if it cannot be read."""
    from hierc.grammar.source import SourceFile

    if isinstance(source, str) and "{" in source:
        return placed(SourceFile("<text>", source), Path("<text>"))
    return read_file(source)


def read_file(source: str | Path) -> ModelText:
    """The model at a path, or a packaged one. Raises `hierc.ModelError` if it cannot be read."""
    from hierc.grammar.reading import read_source
    from hierc.grammar.source import SourceFile

    packaged = packaged_models().get(str(source))
    if packaged is not None and not Path(source).exists():
        return placed(SourceFile(packaged.name, packaged.read_text(encoding="utf-8")), packaged)
    return placed(read_source(source), Path(source))


def placed(source: SourceFile, path: Path) -> ModelText:
    """A model whose text stands, or would stand, at a path."""
    return ModelText(source, Finder(source, path, _folder("hierc.models")))


def packaged_models() -> dict[str, Path]:
    """Models that come with hierc, by name."""
    return {path.stem: path for path in sorted(_folder("hierc.models").glob("*.hier"))}


def prepare(
    text: ModelText,
    experiment: str | None,
    params: Mapping[str, Value],
    *,
    cache: bool = True,
    strict_units: bool = False,
) -> Loaded:
    """The runnable model of a file; see `load`."""
    store = _Store.open(text, experiment, strict_units) if cache else None
    with _modules_beside(text.finder.folder):
        found = store.find(params) if store else None
    if found is not None:
        with suppress(SettingError):  # a parameter that does not fit: the compiler words it
            return Loaded(_with_values(found.model, params), found.warnings, compiled=False)
    from hierc.compiler.driver import compile_source
    from hierc.grammar.render import render, to_json

    made = compile_source(text.source, experiment, params, strict_units=strict_units, reader=text.finder)
    warnings = tuple(Warned(render(problem), to_json(problem)) for problem in made.warnings)
    if store is not None:
        store.keep(params, _Made(frozenset(made.structural), text.finder.seen), made.text, warnings)
    try:
        with _modules_beside(text.finder.folder):
            model = run_module(made.text, text.source.name).MODEL
    except ExternError as error:
        from hierc.compiler.callees.errors import WrongExtern
        from hierc.grammar.problems import ModelError

        span = next(e.span for e in made.externs if e.name == error.name)
        raise ModelError([WrongExtern(span, error.name, error.target, error.reason)]) from error
    return Loaded(_with_values(model, params), warnings, compiled=True)


@contextmanager
def _modules_beside(folder: Path) -> Iterator[None]:
    """While external functions are imported, modules that stand beside the model are found too, after all others."""
    sys.path.append(str(folder))
    try:
        yield
    finally:
        with suppress(ValueError):
            sys.path.remove(str(folder))


def run_module(text: str, name: str) -> ModuleType:
    """Execute the text of a generated module that was made in this process; `name` is the model's, for tracebacks."""
    shown = f"<compiled {name} {_digest(text)[:16]}>"  # the runtime finds each module's text by this name
    module = ModuleType("hierc_model")
    module.__file__ = shown
    linecache.cache[shown] = (len(text), None, text.splitlines(keepends=True), shown)
    exec(builtins.compile(text, shown, "exec"), module.__dict__)  # noqa: S102 - the emitter's own text, made a moment ago
    return module


def _with_values(model: Model, params: Mapping[str, Value]) -> Model:
    plain = {name: value for name, value in params.items() if name not in structural_names(model)}
    built = {name: value for name, value in params.items() if name not in plain}
    return model.with_parameters(plain, built) if params else model


def structural_names(model: Model) -> frozenset[str]:
    """Paths of the parameters that are built into a model's code."""
    return frozenset(p.path.replace("[]", "") for p in model.plan.parameters if p.structural)


@dataclass(frozen=True, slots=True)
class _Found:
    """A cached model and what the compiler warned of."""

    model: Model
    warnings: tuple[Warned, ...]


@dataclass(frozen=True, slots=True)
class _Made:
    """What distinguishes the members of a family: the values of these parameters, and the files that were seen; see `Finder.seen`."""

    structural: frozenset[str]
    seen: Seen

    def member(self, params: Mapping[str, Value]) -> str:
        """The name of the member for these parameters."""
        chosen = sorted((name, _exactly(params[name])) for name in self.structural & set(params))
        return _digest(json.dumps([chosen, sorted(self.seen.items())]))[:16]

    def data(self) -> bytes:
        return json.dumps({"structural": sorted(self.structural), "seen": dict(self.seen)}).encode()

    @classmethod
    def of(cls, data: bytes) -> _Made:
        """What `data` gave. Raises ValueError, TypeError or KeyError if nothing did."""
        fields = json.loads(data)
        return cls(frozenset(fields["structural"]), dict(fields["seen"]))


@dataclass(frozen=True, slots=True)
class _Store:
    """The cached modules of one text and experiment.

    `<family>.json` says what distinguishes the members: it lists the structural parameters met so far, and the files that were read when it was
    written. A member is a module `<family>-<member>.py` with its warnings in `<family>-<member>.json`, which is written first.
    """

    folder: Path
    family: str

    @classmethod
    def open(cls, text: ModelText, experiment: str | None, strict_units: bool) -> _Store | None:
        folder = cache_folder("models")
        source = text.source
        start = (
            text.finder.start if "import" in source.text or "table" in source.text else ()
        )  # else it matters to nothing where the file is
        key = [__version__, _compiler_digest(), source.name, source.text, experiment, strict_units, start]
        return None if folder is None else cls(folder, _digest(json.dumps(key))[:24])

    def find(self, params: Mapping[str, Value]) -> _Found | None:
        """The model for these parameters; None if there is none, or if it does not load."""
        try:
            made = _Made.of((self.folder / f"{self.family}.json").read_bytes())
            if not unchanged(made.seen):
                return None
            stem = f"{self.family}-{made.member(params)}"
            warnings = tuple(
                Warned(*pair) for pair in json.loads((self.folder / f"{stem}.json").read_bytes())
            )
            return _Found(_import_file(self.folder / f"{stem}.py", "hierc_model").MODEL, warnings)
        except Exception:  # whatever is wrong with the files: they are made again
            return None

    def keep(self, params: Mapping[str, Value], made: _Made, text: str, warnings: tuple[Warned, ...]) -> None:
        """Store a module. A cache that cannot be written is no reason to stop."""
        family = self.folder / f"{self.family}.json"
        with suppress(OSError, ValueError, TypeError, KeyError):
            known = _Made.of(family.read_bytes())
            if known.seen == made.seen:
                made = _Made(made.structural | known.structural, made.seen)
        with suppress(OSError):
            stem = f"{self.family}-{made.member(params)}"
            write_whole(
                self.folder / f"{stem}.json", json.dumps([(w.text, w.data) for w in warnings]).encode()
            )
            write_whole(self.folder / f"{stem}.py", text.encode())
            write_whole(family, made.data())
            self._forget_oldest()

    def _forget_oldest(self) -> None:
        files = sorted(self.folder.glob("*.*"), key=lambda file: file.stat().st_mtime_ns)
        for file in files[: max(len(files) - _KEPT, 0)]:
            file.unlink(missing_ok=True)


def _exactly(value: Value) -> str:
    """A value's text with every digit, the same for equal numbers, lists and arrays."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return f"[{','.join(map(_exactly, value))}]"
    return float(value).hex() if isinstance(value, bool | int | float) and abs(value) < 1e300 else repr(value)


def _import_file(path: Path, name: str) -> ModuleType:
    """Import a module from a file of the private cache, with Python's own cache of byte code beside it."""
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _compiler_digest() -> str:
    """Hash of everything that shapes a generated module: while hierc is developed, its version alone does not tell."""
    files = [
        *_folder("hierc.grammar").glob("*.*"),
        *_folder("hierc.compiler").glob("**/*.py"),
        _folder("hierc.runtime") / "contract.py",
    ]
    return _digest(*(file.read_bytes() for file in sorted(files) if file.suffix in {".py", ".lark"}))


def _folder(package: str) -> Path:
    """Where a package's files are, without importing it."""
    spec = importlib.util.find_spec(package)
    return Path(cast(list[str], spec and spec.submodule_search_locations)[0])


def _digest(*parts: str | bytes) -> str:
    sha = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        sha.update(len(data).to_bytes(8) + data)
    return sha.hexdigest()
