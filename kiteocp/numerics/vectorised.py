"""A CasADi function of scalar expressions evaluated for many columns at once, by NumPy.

CasADi's virtual machine spends most of its time on fetching the next of some thousand operations. Here each operation
runs on an array of columns, which costs a third as much for a thousand columns. The operations are those of the
function (CasADi gives them out), so that nothing is written twice.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

#: Columns that are worked on together: enough to make the calls cheap, few enough for the cache.
COLUMNS = 1024

#: Fewer columns than this go through CasADi, which has no cost for each operation.
FEWEST_COLUMNS = 350

Operation = Callable[..., Any]


def _if_else_zero(condition: np.ndarray, value: np.ndarray, out: np.ndarray) -> None:
    # Not a product: what is not taken may be no number.
    out[:] = np.where(condition != 0, value, 0.0)


def _twice(value: np.ndarray, out: np.ndarray) -> None:
    np.add(value, value, out=out)


#: NumPy's equivalents of the operations; comparisons give 1 and 0 as CasADi's do.
OPERATIONS: dict[int, Operation] = {
    ca.OP_ASSIGN: np.positive,
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_INV: np.reciprocal,
    ca.OP_SQ: np.square,
    ca.OP_TWICE: _twice,
    ca.OP_SQRT: np.sqrt,
    ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power,
    ca.OP_EXP: np.exp,
    ca.OP_LOG: np.log,
    ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos,
    ca.OP_TAN: np.tan,
    ca.OP_ASIN: np.arcsin,
    ca.OP_ACOS: np.arccos,
    ca.OP_ATAN: np.arctan,
    ca.OP_ATAN2: np.arctan2,
    ca.OP_FABS: np.fabs,
    ca.OP_FMIN: np.fmin,
    ca.OP_FMAX: np.fmax,
    ca.OP_FLOOR: np.floor,
    ca.OP_LT: np.less,
    ca.OP_LE: np.less_equal,
    ca.OP_EQ: np.equal,
    ca.OP_NE: np.not_equal,
    ca.OP_NOT: np.logical_not,
    ca.OP_AND: np.logical_and,
    ca.OP_OR: np.logical_or,
    ca.OP_IF_ELSE_ZERO: _if_else_zero,
}


class VectorisedFunction:
    """A CasADi function of one dense vector with scalar outputs, for many columns of its argument.

    Parameters
    ----------
    function
        An SX function.

    Raises
    ------
    NotImplementedError
        The function has an operation that is not in `OPERATIONS`.
    """

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        work = np.empty((function.sz_w(), COLUMNS))
        self._input = np.empty((function.nnz_in(0), COLUMNS))
        self._output = np.empty((function.n_out(), COLUMNS))
        #: Operation, operands, result, in the order of the function; all arrays are rows of the three above.
        self._calls: list[tuple[Operation, tuple[np.ndarray, ...], np.ndarray]] = []
        for index in range(function.n_instructions()):
            code = function.instruction_id(index)
            operands, results = function.instruction_input(index), function.instruction_output(index)
            if code == ca.OP_CONST:
                constant = np.full(COLUMNS, function.instruction_constant(index))
                self._calls.append((np.positive, (constant,), work[results[0]]))
            elif code == ca.OP_INPUT:
                self._calls.append((np.positive, (self._input[operands[1]],), work[results[0]]))
            elif code == ca.OP_OUTPUT:
                self._calls.append((np.positive, (work[operands[0]],), self._output[results[0]]))
            elif code in OPERATIONS:
                self._calls.append((OPERATIONS[code], tuple(work[place] for place in operands), work[results[0]]))
            else:
                raise NotImplementedError(f"operation {code} of CasADi")

    def __call__(self, columns: np.ndarray) -> np.ndarray:
        """Evaluate for columns of shape (arguments, n); return the outputs, shape (outputs, n)."""
        count = columns.shape[1]
        results = np.empty((self._output.shape[0], count))
        for first in range(0, count, COLUMNS):
            block = columns[:, first : first + COLUMNS]
            if block.shape[1] < FEWEST_COLUMNS:
                found = self._function.map(block.shape[1])(block)
                results[:, first:] = [np.asarray(output).ravel() for output in found]
                continue
            self._input[:, : block.shape[1]] = block
            # What the columns beyond the last hold does not matter, but odd numbers would cost time.
            self._input[:, block.shape[1] :] = block[:, -1:]
            with np.errstate(all="ignore"):
                for operation, operands, result in self._calls:
                    operation(*operands, out=result)
            results[:, first : first + COLUMNS] = self._output[:, : block.shape[1]]
        return results
