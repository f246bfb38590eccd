"""CasADi functions called on fixed memory, for loops that step through a cycle."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt


class BufferedFunction:
    """A CasADi function of dense arguments, called without the conversions of a normal call (some microseconds).

    The returned arrays are overwritten by the next call.
    """

    def __init__(self, function: ca.Function) -> None:
        buffer: Any
        buffer, self._run = function.buffer()
        # The memory is the buffer's as long as the buffer lives.
        self._buffer = buffer
        self._inputs = [np.zeros(function.nnz_in(i)) for i in range(function.n_in())]
        self._outputs = [np.zeros(function.nnz_out(i)) for i in range(function.n_out())]
        for i, array in enumerate(self._inputs):
            buffer.set_arg(i, array.data)
        for i, array in enumerate(self._outputs):
            buffer.set_res(i, array.data)

    def call(self, *arguments: npt.ArrayLike) -> list[np.ndarray]:
        """Evaluate; the arguments in the function's order, flat."""
        for array, value in zip(self._inputs, arguments, strict=True):
            array[:] = value
        self._run()
        return self._outputs

    def __call__(self, *arguments: npt.ArrayLike) -> np.ndarray:
        """Evaluate and return the first output."""
        return self.call(*arguments)[0]
