"""Arithmetic of packed complex numbers: one for each eigenvalue of a method, real parts in the lower half of the lanes, imaginary parts in the upper half."""

from __future__ import annotations

from llvmlite import ir

from hierc.runtime.machine.arithmetic import Arithmetic
from hierc.runtime.machine.types import Float, Value, llvm_type

#: A packed number as a factor: (re, re) and (-im, im); or a real one, the same for all eigenvalues.
Factor = tuple[Value, Value] | Value


class Packed:
    """Emits arithmetic over `lanes` lanes. Products and sums may be contracted."""

    def __init__(self, builder: ir.IRBuilder, lanes: int) -> None:
        self.math = Arithmetic(builder, contract=True)
        self.kind = Float(lanes)
        half = lanes // 2
        self._lower, self._upper = list(range(half)), list(range(half, lanes))
        self._signs = self.constant([-1.0] * half + [1.0] * half)
        #: The number 1.
        self.one = self.constant([1.0] * half + [0.0] * half)

    def constant(self, lanes: list[float]) -> Value:
        """A number for each lane."""
        return Value(ir.Constant(llvm_type(self.kind), lanes), self.kind)

    def spread(self, a: Value) -> tuple[Value, Value]:
        """A number as a factor."""
        signed = self.math.binary("Mult", self.math.shuffle(a, self._upper + self._upper), self._signs)
        return self.math.shuffle(a, self._lower + self._lower), signed

    def swap(self, a: Value) -> Value:
        """Imaginary parts below real ones."""
        return self.math.shuffle(a, self._upper + self._lower)

    def factor(self, a: Value) -> Factor:
        """A packed or real number as a factor."""
        return a if a.type == Float() else self.spread(a)

    def joined(self, a: tuple[Value, Value]) -> Value:
        """The number that a factor is."""
        lanes = self.kind.lanes
        return self.math.shuffle(a[0], [*self._lower, *(lanes + k for k in self._upper)], a[1])

    def times(self, a: Factor, b: Value) -> Value:
        """a*b."""
        if isinstance(a, Value):
            return self.math.binary("Mult", a, b)
        straight = self.math.binary("Mult", a[0], b)
        return self.math.binary("Add", straight, self.math.binary("Mult", a[1], self.swap(b)))

    def product(self, a: tuple[Value, Value], b: Value) -> Value:
        """The product of a factor and a packed or real number."""
        return self.math.binary("Mult", b, self.joined(a)) if b.type == Float() else self.times(a, b)

    def inverse(self, a: Value) -> Value:
        """1/a."""
        squares = self.math.binary("Mult", a, a)
        modulus = self.math.binary("Add", squares, self.swap(squares))
        conjugate = self.math.binary("Mult", a, self.math.negate(self._signs))
        return self.math.binary("Mult", conjugate, self.math.binary("Div", 1.0, modulus))
