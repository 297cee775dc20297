"""External functions of a generated module: Python functions of the user's, called by the model's equations.

An `Extern` is imported when the module is. Plain Python calls it as it is; machine code has it compiled in where `machine.translate` can, and calls back
into Python where it cannot, which is slow. A `Watch` carries what goes wrong in such a call past the machine code: the call answers NaN at once, the
step under way is given up, and Python raises the error when the kernel has returned.
"""

from __future__ import annotations

import ctypes
import importlib
import inspect
import math
import numbers
import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numpy as np

from hierc.runtime.errors import ExternError
from hierc.runtime.machine.translate import Translation, translate
from hierc.runtime.machine.types import UnsupportedCode

_NAN = float("nan")


class Extern:
    """An external function. `target` is `module:function`; `shapes` and `scales` are those of its arguments; numbers are in SI on this side.

    One of the declared unit of argument k is `scales[k]` in SI, one of the result's is `scale`. Raises ExternError if there is no such function, or
    none that takes so many arguments.
    """

    def __init__(
        self,
        name: str,
        target: str,
        shapes: tuple[tuple[int, ...], ...],
        scales: tuple[float, ...],
        scale: float = 1.0,
    ) -> None:
        self.name, self.target, self.shapes, self.scales, self.scale = name, target, shapes, scales, scale
        self.function = self._imported()
        self._check_arguments()
        #: Whether it has been said that it is slow.
        self.told = False

    @property
    def arguments(self) -> int:
        """How many numbers it takes, the elements of vectors counted."""
        return sum(math.prod(shape) for shape in self.shapes)

    def __repr__(self) -> str:
        return f"<extern {self.name}: {self.target}>"

    # ---- where it comes from ----------------------------------------------------------------------

    def _imported(self) -> Callable[..., Any]:
        module, _, path = self.target.partition(":")
        try:
            found: Any = importlib.import_module(module)
        except ModuleNotFoundError as error:
            if error.name is not None and (module == error.name or module.startswith(f"{error.name}.")):
                raise self._error(f"there is no module `{error.name}`") from None
            raise self._error(f"module `{module}` cannot be imported: {_told(error)}") from error
        except Exception as error:
            raise self._error(f"module `{module}` cannot be imported: {_told(error)}") from error
        for step in path.split("."):
            if not hasattr(found, step):
                raise self._error(f"`{module}` has no function `{path}`")
            found = getattr(found, step)
        if not callable(found):
            raise self._error(f"`{path}` is not a function")
        function: Callable[..., Any] = found
        return function

    def _check_arguments(self) -> None:
        try:
            signature = inspect.signature(self.function)
        except (TypeError, ValueError):  # written in C: nothing is known of it
            return
        try:
            signature.bind(*self.shapes)
        except TypeError:
            wanted = "1 argument" if len(self.shapes) == 1 else f"{len(self.shapes)} arguments"
            function = self.target.partition(":")[2]
            raise self._error(f"`{function}{signature}` cannot be called with {wanted}") from None

    def _error(self, reason: str) -> ExternError:
        return ExternError(self.name, self.target, reason)

    # ---- calls ----------------------------------------------------------------------------------

    def __call__(self, *args: float) -> float:
        """Its value, for its arguments' elements one after the other. Raises ExternError where it raises or returns what is no number."""
        try:
            value = self.function(*self._given(args))
        except (Exception, SystemExit) as error:
            raise self._error(_told(error)) from error
        if isinstance(value, np.ndarray) and value.shape == () and value.dtype.kind in "biuf":
            value = value.item()
        if not isinstance(value, numbers.Real | np.bool_):
            shown = " ".join(repr(value).split())
            shown = shown if len(shown) <= 60 else f"{shown[:57]}..."
            raise self._error(f"returned {shown}, which is not a number")
        return float(value) * self.scale if self.scale != 1.0 else float(value)

    def _given(self, args: tuple[float, ...]) -> Iterator[Any]:
        """The function's arguments, in the declared units: floats, and arrays of them."""
        place = 0
        for shape, scale in zip(self.shapes, self.scales, strict=True):
            own = [
                float(a) if scale == 1.0 else float(a) / scale for a in args[place : place + math.prod(shape)]
            ]
            place += len(own)
            yield np.array(own).reshape(shape) if shape else own[0]

    # ---- machine code -----------------------------------------------------------------------------

    @cached_property
    def translation(self) -> Translation | str:
        """The function as text that can be compiled, or why there is none."""
        if any(self.shapes):
            return "it takes vectors"
        try:
            return translate(self.function, len(self.shapes))
        except UnsupportedCode as error:
            return str(error)

    @cached_property
    def callback(self) -> Any:
        """The function for machine code to call: its address, as ctypes has it."""
        kinds = [ctypes.c_double] * (1 + self.arguments)
        return ctypes.CFUNCTYPE(*kinds)(self._called)

    def _called(self, *args: float) -> float:
        """A call from machine code, through which no exception may pass."""
        watch = _Current.watch
        try:
            if watch.failure is not None:
                return _NAN
            watch.inside = True
            value = self(*args)
            watch.inside = False
        except BaseException as error:
            watch.inside = False
            watch.fail(error)
            return _NAN
        return value


def _told(error: BaseException) -> str:
    """An exception in one line, with the user's line it came from."""
    last = traceback.extract_tb(error.__traceback__)[-1:]
    own = [f" ({frame.filename}, line {frame.lineno})" for frame in last if frame.filename != __file__]
    text = " ".join(str(error).split())
    return f"{type(error).__name__}{': ' if text else ''}{text}{''.join(own)}"


class Watch:
    """What happens to external functions while machine code runs. `abandon` is called once, at the first failure."""

    def __init__(self, abandon: Callable[[], None]) -> None:
        self.abandon = abandon
        self.inside = False
        self.failure: BaseException | None = None

    def fail(self, error: BaseException) -> None:
        """Keep an error for later, and have the machine code return soon."""
        if self.failure is None:
            self.failure = error
            self.abandon()

    @contextmanager
    def over(self) -> Iterator[None]:
        """Run machine code within this: calls of externs report here. Afterwards the failure, if any, is raised.

        Ctrl-C stops the user's function where it is inside one. Elsewhere it waits: raised between machine code and Python, it would be lost.
        """
        outer, _Current.watch = _Current.watch, self
        ours = (
            threading.current_thread() is threading.main_thread()
            and signal.getsignal(signal.SIGINT) is signal.default_int_handler
        )
        if ours:
            signal.signal(signal.SIGINT, self._interrupted)
        try:
            yield
        finally:
            if ours:
                signal.signal(signal.SIGINT, signal.default_int_handler)
            _Current.watch = outer
        if self.failure is not None:
            failure, self.failure = self.failure, None
            raise failure

    def _interrupted(self, number: int, frame: object) -> None:
        if self.inside:
            raise KeyboardInterrupt
        self.fail(KeyboardInterrupt())


class _PerThread(threading.local):
    """The watch of each thread's run."""

    def __init__(self) -> None:
        self.watch = Watch(lambda: None)


_Current = _PerThread()
