"""Solving a nonlinear program with IPOPT: built once, called with numbers."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike, NDArray

from kiteocp.execution import interrupted, leave_if_interrupted
from kiteocp.ocp.collocation import FloatArray
from kiteocp.ocp.nlp import NonlinearProgram

DEFAULT_IPOPT_OPTIONS: Mapping[str, Any] = {
    "linear_solver": "mumps",
    "mu_strategy": "adaptive",
    "fast_step_computation": "yes",
    "tol": 1e-8,
    "max_iter": 300,
    # IPOPT widens every bound by 1e-8 of its value, visible as a force "above" its limit. Zero would leave no
    # interior to a problem whose bounds pin a variable from both sides; this is far below every tolerance.
    "bound_relax_factor": 1e-10,
    # Variables and rows come scaled; automatic scaling would make `tol` mean something else for every start.
    "nlp_scaling_method": "none",
    "print_level": 0,
    "sb": "yes",
}
"""Options of IPOPT, see https://coin-or.github.io/Ipopt/OPTIONS.html."""

STOPPED = "Stopped_Early"
"""Our word for a solution that was ended because it took longer than the caller had patience for."""

INFEASIBLE = "Infeasible_Problem_Detected"
"""IPOPT's word for a point where the violation of the constraints has a local minimum above zero."""

WARM_IPOPT_OPTIONS: Mapping[str, Any] = {
    "warm_start_init_point": "yes",
    "warm_start_bound_push": 1e-8,
    "warm_start_bound_frac": 1e-8,
    "warm_start_slack_bound_push": 1e-8,
    "warm_start_slack_bound_frac": 1e-8,
    "warm_start_mult_bound_push": 1e-8,
}
"""What changes when a neighbouring solution with its multipliers is the start.

Pushes this small keep active bounds active: 2 to 7 iterations for parameters 0.1 to 10 % away, against 3 to 10 with
pushes of 1e-4, and 4 to 10 with the monotone strategy from a barrier of 1e-6.
"""

NEAR_IPOPT_OPTIONS: Mapping[str, Any] = {
    "mu_strategy": "monotone",
    "mu_init": 1e-4,
    "bound_push": 1e-6,
    "bound_frac": 1e-6,
}
"""What changes when the start is near the solution but without multipliers: it is not pushed away from its bounds."""

DECIDING_IPOPT_OPTIONS: Mapping[str, Any] = {"tol": 1e-12, "mu_min": 1e-15, "compl_inf_tol": 1e-12}
"""What changes, beside a warm start, to tell active bounds from those that do not.

The barrier leaves slack times multiplier at some 1e-11. Where the optimum is so flat that multipliers are 1e-6, the
slack is as large, and nobody can tell. With a product of 1e-15 one of the two is large.
"""


WATCHED_EVERY, WATCHED_VARIABLES = 10, 300
"""Iterations between two looks whether the calculation was interrupted, in programs of so many variables at most; they
cost less than 1 % of a solution. Iterations of larger programs take longer: there it is every one."""


class _Watch(ca.Callback):
    """Ends a solution when the calculation is interrupted, or has looked for the solution long enough.

    Attributes
    ----------
    looks
        How often it may still look before it ends the solution; None for as often as there is reason to.
    """

    def __init__(self, variables: int, rows: int, parameters: int) -> None:
        super().__init__()
        self.looks: int | None = None
        self._sizes = {"x": variables, "f": 1, "g": rows, "lam_x": variables, "lam_g": rows, "lam_p": parameters}
        self.construct("watch", {})

    def get_n_in(self) -> int:
        """Return the number of what IPOPT tells after an iteration."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """Return 1: whether to stop."""
        return 1

    def get_sparsity_in(self, index: int) -> Any:
        """Return the shape of one of them."""
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(index)], 1)

    def eval(self, _told: Any) -> list[int]:
        """Return 1 to stop."""
        if self.looks is not None:
            self.looks -= 1
        return [int(interrupted() or (self.looks is not None and self.looks < 0))]


class Solution(msgspec.Struct, frozen=True):
    """What the solver returned, converged or not.

    Attributes
    ----------
    x, g, lam_x, lam_g
        Variables and rows (scaled as in the program) and their multipliers: positive at an upper bound, negative at
        a lower one, so that grad f + (dg/dx)' lam_g + lam_x = 0. Shapes (variables,) and (rows,).
    p
        Parameters it was solved for.
    f
        Objective.
    success
        Whether the solver met its tolerances.
    status
        The solver's word for how it ended.
    iterations
        Number of iterations.
    time_s
        Wall time of the call.
    method
        What solved it.

    """

    x: FloatArray
    f: float
    g: FloatArray
    lam_x: FloatArray
    lam_g: FloatArray
    p: FloatArray
    success: bool
    status: str
    iterations: int
    time_s: float
    method: str = "IPOPT"


class Solver:
    """IPOPT for one program, with exact derivatives that are generated once.

    Parameters
    ----------
    program
        What to solve.
    options
        IPOPT options that replace or extend `DEFAULT_IPOPT_OPTIONS`.
    deferred
        Indices of inequality rows that are expected to hold by themselves. A cold start leaves them out; if the
        solution keeps them it solves the whole program too, its multipliers there being zero, and otherwise the whole
        program is solved from it. Rows cost IPOPT more than variables: this halves the time where it goes well.

    """

    def __init__(
        self,
        program: NonlinearProgram,
        options: Mapping[str, Any] | None = None,
        deferred: Sequence[int] | NDArray[np.intp] = (),
    ) -> None:
        self.program = program
        self.options = {**DEFAULT_IPOPT_OPTIONS, **(options or {})}
        # CasADi keeps no reference to them.
        self._watches: dict[str, _Watch] = {}
        kept = np.ones(len(program.rows), dtype=bool)
        kept[np.asarray(deferred, dtype=np.intp)] = False
        self._kept = np.flatnonzero(kept)
        self._deferred = len(deferred) > 0

    @cached_property
    def _lean(self) -> Any:
        return self._build("lean_solver", self.options, self._kept)

    @cached_property
    def _cold(self) -> Any:
        return self._build("solver", self.options)

    @cached_property
    def _warm(self) -> Any:
        return self._build("warm_solver", {**self.options, **WARM_IPOPT_OPTIONS})

    @cached_property
    def _near(self) -> Any:
        return self._build("near_solver", {**self.options, **NEAR_IPOPT_OPTIONS})

    @cached_property
    def _deciding(self) -> Any:
        return self._build("deciding_solver", {**self.options, **WARM_IPOPT_OPTIONS, **DECIDING_IPOPT_OPTIONS})

    def _build(self, name: str, ipopt: Mapping[str, Any], rows: NDArray[np.intp] | None = None) -> Any:
        composed, (nx, np_) = self.program.composition, (len(self.program.variables), self.program.p.numel())
        x, p = ca.MX.sym("x", nx), ca.MX.sym("p", np_)
        f, g = composed.values(x, p)
        if rows is None:
            jacobian, hessian = composed.jacobian, composed.hessian
        else:
            g = g[rows.tolist()]
            jacobian, hessian = composed.of_rows(rows.tolist())
        watch = self._watches[name] = _Watch(nx, g.numel(), np_)
        options: dict[str, Any] = {
            "ipopt": dict(ipopt),
            "iteration_callback": watch,
            "iteration_callback_step": WATCHED_EVERY if nx <= WATCHED_VARIABLES else 1,
            "print_time": False,
            "show_eval_warnings": False,
            "error_on_fail": False,
            # The gradient with respect to p is `optimality.parametric_gradient`, which knows the bounds too.
            "calc_lam_p": False,
            "no_nlp_grad": True,
            "grad_f": composed.gradient,
            "jac_g": jacobian,
            "hess_lag": hessian,
        }
        return ca.nlpsol(name, "ipopt", {"x": x, "p": p, "f": f, "g": g}, options)

    def solve(
        self,
        x0: ArrayLike,
        p: ArrayLike = (),
        warm: Solution | None = None,
        pinned: Mapping[int, float] | None = None,
        *,
        near: bool = False,
        deciding: bool = False,
        patience: int | None = None,
    ) -> Solution:
        """Solve for one set of parameters.

        Parameters
        ----------
        x0
            Start, shape (variables,), from `NonlinearProgram.pack`. Not used when `warm` is given.
        p
            Parameters, shape (parameters,).
        warm
            A neighbouring solution of the same program: its variables and multipliers are the start.
        pinned
            Variables held at a value (scaled as in the program), by index.
        near
            The start is close to a solution, as one on another mesh is: stay there.
        deciding
            With `warm`: go on until it is clear which bounds are active (`DECIDING_IPOPT_OPTIONS`).
        patience
            Iterations after which a cold start is given up, about; its `status` is `STOPPED` then.

        Returns
        -------
        Solution
            Also when the solver failed; look at `success`.

        Raises
        ------
        ValueError
            If the parameters are not finite, of the wrong number, or make bounds cross.
        KeyboardInterrupt
            It was interrupted.

        """
        began = time.perf_counter()
        parameters = np.asarray(p, dtype=float).ravel()
        expected = self.program.p.numel()
        if parameters.size != expected or not np.all(np.isfinite(parameters)):
            raise ValueError(f"the program takes {expected} finite parameters, not {parameters}")
        lbx, ubx, lbg, ubg = self.program.numeric_bounds(parameters)
        for index, value in (pinned or {}).items():
            lbx[index] = ubx[index] = value
        arguments = {"p": parameters, "lbx": lbx, "ubx": ubx}
        spent = 0
        if warm is not None:
            solver = self._deciding if deciding else self._warm
            arguments |= {"x0": warm.x, "lam_x0": warm.lam_x, "lam_g0": warm.lam_g, "lbg": lbg, "ubg": ubg}
            result = solver(**arguments)
        elif near:
            solver = self._near
            result = solver(x0=np.asarray(x0, dtype=float), **arguments, lbg=lbg, ubg=ubg)
        else:
            arguments["x0"] = np.asarray(x0, dtype=float)
            if self._deferred:
                lean = self._solve_lean(arguments, lbg, ubg, patience)
                spent = int(self._lean.stats()["iter_count"])
                # What has no feasible point without the deferred rows has none with them.
                if lean.status in {INFEASIBLE, STOPPED} or (lean.success and self._keeps_all(lean, lbg, ubg)):
                    return replace(lean, time_s=time.perf_counter() - began)
                if lean.success:
                    arguments["x0"] = lean.x
            solver = self._cold
            self._be_patient(solver, patience)
            result = solver(**arguments, lbg=lbg, ubg=ubg)
        solution = _solution(solver, result, parameters)
        return replace(solution, iterations=spent + solution.iterations, time_s=time.perf_counter() - began)

    def _be_patient(self, solver: Any, patience: int | None) -> None:
        every = WATCHED_EVERY if len(self.program.variables) <= WATCHED_VARIABLES else 1
        self._watches[solver.name()].looks = None if patience is None else patience // every

    def _solve_lean(
        self, arguments: Mapping[str, Any], lbg: FloatArray, ubg: FloatArray, patience: int | None
    ) -> Solution:
        """Solve without the deferred rows, whose multipliers are zero."""
        self._be_patient(self._lean, patience)
        result = self._lean(**arguments, lbg=lbg[self._kept], ubg=ubg[self._kept])
        solution = _solution(self._lean, result, arguments["p"])
        multipliers = np.zeros(len(self.program.rows))
        multipliers[self._kept] = solution.lam_g
        rows = self.program.composition.values(solution.x, solution.p)[1].full().ravel()
        return replace(solution, g=rows, lam_g=multipliers)

    def _keeps_all(self, solution: Solution, lbg: FloatArray, ubg: FloatArray) -> bool:
        """Whether a solution of the lean program keeps the deferred rows, to the tolerance of the solver."""
        tolerance = float(self.options["tol"])
        within = (solution.g >= lbg - tolerance) & (solution.g <= ubg + tolerance)
        return bool(within.all())


def _solution(solver: Any, result: Mapping[str, Any], parameters: FloatArray) -> Solution:
    # What an interrupted solution left is not one.
    leave_if_interrupted()
    statistics = solver.stats()
    x, g, lam_x, lam_g = (result[name].full().ravel() for name in ("x", "g", "lam_x", "lam_g"))
    objective = float(result["f"])
    return Solution(
        x, objective, g, lam_x, lam_g, parameters,
        success=bool(statistics["success"]) and math.isfinite(objective),
        status=STOPPED if statistics["return_status"] == "User_Requested_Stop" else str(statistics["return_status"]),
        iterations=int(statistics["iter_count"]),
        time_s=0.0,
    )  # fmt: skip
