"""The elastic version of a nonlinear program: its parameters may move, at a price.

Where a program has no feasible point, the cheapest move of its parameters that gives it one says what is wrong. A
`ElasticSlack` is one slack s >= 0 that moves some parameters, p + s * amount; whatever depends on them, bounds of
variables and of rows as well as the rows themselves, follows. With positive weights w the elastic program is::

    minimise w' s + 1e-3 s' s    subject to the program's rows and bounds at the moved parameters, 0 <= s <= cap

which is feasible as soon as the slacks reach far enough, and zero exactly where the program itself is feasible
(Chinneck 2008, Feasibility and Infeasibility in Optimization). Amounts, weights and caps are numbers, so that one
build serves every question asked of one structure. To ask what some slacks can do alone, give the others a large
weight rather than hold them: the program then stays feasible, which IPOPT finds easy, and if they vanish from the
optimum they were not needed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike

from kiteocp.ocp.collocation import FloatArray
from kiteocp.ocp.composition import Composition
from kiteocp.ocp.nlp import Label, NonlinearProgram
from kiteocp.ocp.nlpsolver import Solution, Solver

#: PenaltyWeight of the square of a slack, beside 1 for the slack: makes the optimum of several equal ones unique.
SQUARE_WEIGHT = 1e-3

#: Where every slack starts: inside its bounds, and enough to leave the crude starts some room.
SLACK_START = 0.1

#: A slack that the solver did not use, at its tolerance.
VANISHED = 1e-6

#: Its answer is a number for people, so 1e-6 is enough; what is feasible is checked by the program itself afterwards.
ELASTIC_IPOPT_OPTIONS: Mapping[str, Any] = {"tol": 1e-6, "max_iter": 200}


class ElasticSlack(msgspec.Struct, frozen=True):
    """One slack and the parameters it moves.

    Attributes
    ----------
    name
        For reports.
    parameters
        Indices in the parameter vector.
    """

    name: str
    parameters: tuple[int, ...]


class PenaltyWeight(msgspec.Struct, frozen=True):
    """What a term costs and how far it goes.

    Attributes
    ----------
    amount
        Change of its parameters for a slack of one, shape (number of its parameters,).
    cap
        Largest slack; zero holds the parameters. The bounds of variables must widen all the way to it.
    weight
        PenaltyWeight of a slack of one.
    """

    amount: ArrayLike
    cap: float
    weight: float = 1.0


class ElasticSolution(msgspec.Struct, frozen=True):
    """The cheapest move found from one start.

    Attributes
    ----------
    solution
        As the solver returned it, of the elastic program.
    x
        Variables of the program itself, shape (variables,).
    p
        Moved parameters, shape (parameters,).
    slacks
        Of every term.
    """

    solution: Solution
    x: FloatArray
    p: FloatArray
    slacks: Mapping[str, float]

    @property
    def success(self) -> bool:
        """Whether the solver met its tolerances."""
        return self.solution.success


class ElasticProgram:
    """A program whose parameters may move, and its solver; built once.

    Parameters
    ----------
    program
        The program as it is.
    terms
        What may move. Those that no row and no bound depends on are left out.
    options
        IPOPT options that replace or extend `ELASTIC_IPOPT_OPTIONS`.

    Attributes
    ----------
    terms
        Those that bear on feasibility.
    rows
        Label of every row of the elastic program; a bound that moves is a row of its own, with the label of the
        variable or row that it bounds.
    """

    def __init__(
        self, program: NonlinearProgram, terms: Sequence[ElasticSlack], options: Mapping[str, Any] | None = None
    ) -> None:
        self.program = program
        self.terms = tuple(term for term in terms if _affects_feasibility(program, term))
        count, moved_count = len(self.terms), sum(len(term.parameters) for term in self.terms)
        slacks, amounts = ca.SX.sym("slack", count), ca.SX.sym("amount", moved_count)
        weights, caps = ca.SX.sym("weight", count), ca.SX.sym("cap", count)
        moved, used = ca.SX(program.p), 0
        for index, term in enumerate(self.terms):
            for parameter in term.parameters:
                moved[parameter] += slacks[index] * amounts[used]
                used += 1
        rows, (lbg, ubg), self._origins = _relieved(program, moved, slacks)
        self.rows = tuple(origin.label for origin in self._origins)
        share = ca.SX.sym("share")
        (objective,) = ca.Function("objective", [program.x, program.p], [program.f]).call([program.x, moved])
        parameters = ca.vertcat(program.p, amounts, weights, caps, share)
        # A variable keeps the bounds that hold at the ends of all slacks, lest it leave the domain of the model.
        lbx, ubx = ca.substitute(list(program.bounds(moved))[:2], [slacks], [caps])
        limits = [ca.vertcat(lbx, ca.SX.zeros(count)), ca.vertcat(ubx, caps), lbg, ubg]
        elastic = replace(
            program,
            composition=Composition(
                ca.vertcat(program.x, slacks),
                parameters,
                share * objective + ca.dot(weights, slacks) + SQUARE_WEIGHT * ca.sumsqr(slacks),
                rows,
            ),
            bounds=ca.Function("bounds", [parameters], limits, ["p"], ["lbx", "ubx", "lbg", "ubg"]),
            variables=(*program.variables, *(Label("slack", term.name) for term in self.terms)),
            rows=self.rows,
        )
        self.solver = Solver(elastic, {**ELASTIC_IPOPT_OPTIONS, **(options or {})})
        self._moved = ca.Function("moved", [slacks, parameters], [moved])
        self._values = ca.Function("values", [program.x, program.p], [program.f, program.g])
        self._effect = ca.Function("effect", [elastic.x, parameters], [ca.jacobian(rows, slacks)])

    def solve(
        self,
        x0: ArrayLike,
        p: ArrayLike,
        penalties: Mapping[str, PenaltyWeight],
        objective_share: float = 0.0,
        slacks: Mapping[str, float] | None = None,
    ) -> ElasticSolution:
        """Find the cheapest move from one start.

        Parameters
        ----------
        x0
            Start of the program itself, shape (variables,).
        p
            Parameters of the program, shape (parameters,).
        penalties
            Of the terms that may be used; the others are held.
        objective_share
            Share of the program's own objective. With 1 and large weights this is the program itself by an exact
            penalty method, which finds optima of feasible sets that are too thin for an interior point method.
        slacks
            Where the slacks start; those not named start at `SLACK_START`.

        Returns
        -------
        ElasticSolution
            Also when the solver failed; look at `success`.
        """
        held = {term.name: PenaltyWeight(np.zeros(len(term.parameters)), 0.0) for term in self.terms}
        chosen = [penalties.get(term.name, held[term.name]) for term in self.terms]
        amounts = [np.atleast_1d(np.asarray(price.amount, dtype=float)) for price in chosen]
        caps = np.array([price.cap for price in chosen])
        weights = np.array([price.weight for price in chosen])
        parameters = np.concatenate([np.asarray(p, dtype=float), *amounts, weights, caps, [objective_share]])
        wanted = np.array([(slacks or {}).get(term.name, SLACK_START) for term in self.terms])
        start = np.concatenate([np.asarray(x0, dtype=float), np.minimum(wanted, 0.5 * caps)])
        solution = self.solver.solve(start, parameters)
        split = len(self.program.variables)
        moves = solution.x[split:]
        names = [term.name for term in self.terms]
        return ElasticSolution(
            solution,
            solution.x[:split],
            self._moved(moves, parameters).full().ravel(),
            dict(zip(names, map(float, moves), strict=True)),
        )

    def optimum(self, found: ElasticSolution) -> Solution:
        """Read an elastic solution of full objective share that moved nothing as one of the program itself.

        Its multipliers become those of the program's rows and bounds, good enough to start the program's own solver
        warm. It counts as a success where the elastic one was and no slack is above `VANISHED`.
        """
        split = len(self.program.variables)
        lam_x, lam_g = found.solution.lam_x[:split].copy(), np.zeros(len(self.program.rows))
        for origin, multiplier in zip(self._origins, found.solution.lam_g, strict=True):
            target = lam_g if origin.is_row else lam_x
            target[origin.index] += origin.sign * multiplier
        p = found.solution.p[: self.program.p.numel()]
        objective, rows = self._values(found.x, p)
        return replace(
            found.solution,
            x=found.x,
            f=float(objective),
            g=rows.full().ravel(),
            lam_x=lam_x,
            lam_g=lam_g,
            p=p,
            success=found.success and max(found.slacks.values(), default=0.0) <= VANISHED,
        )

    def savings(self, found: ElasticSolution, name: str) -> FloatArray:
        """Return what a little more of a slack would save through each row, from the multipliers.

        The rows through which a slack acts are where its limit bites. Over all rows a slack in use saves its
        weight; one that has no part in the conflict saves nothing.

        Returns
        -------
        ndarray, shape (rows,)
        """
        index = [term.name for term in self.terms].index(name)
        effect = np.asarray(self._effect(found.solution.x, found.solution.p).full()[:, index], dtype=np.float64)
        return np.asarray(-found.solution.lam_g * effect, dtype=np.float64)


def _affects_feasibility(program: NonlinearProgram, term: ElasticSlack) -> bool:
    """Whether any row or bound depends on the parameters of a term."""
    symbols = program.p[list(term.parameters)]
    return bool(ca.depends_on(ca.veccat(program.g, *program.bounds(program.p)), symbols))


class _Origin(msgspec.Struct, frozen=True):
    """What a row of the elastic program is made of: a row or a variable of the program, times a sign."""

    label: Label
    is_row: bool
    index: int
    sign: float


def _relieved(program: NonlinearProgram, moved: Any, slacks: Any) -> tuple[Any, tuple[Any, Any], tuple[_Origin, ...]]:
    """Return rows, their bounds and their origins, every bound that moves made a row of its own."""
    lbx, ubx, lbg, ubg = (ca.SX(bound) for bound in program.bounds(moved))
    (fixed_rows,) = ca.Function("rows", [program.x, program.p], [program.g]).call([program.x, moved])
    rows, lower, upper, origins = [], [], [], []
    for expressions, low, high, names, is_row in (
        (program.x, lbx, ubx, program.variables, False),
        (fixed_rows, lbg, ubg, program.rows, True),
    ):
        for index, label in enumerate(names):
            value, own = expressions[index], [low[index], high[index]]
            for side, (bound, sign) in enumerate(((low[index], 1.0), (high[index], -1.0))):
                if ca.depends_on(bound, slacks):
                    # Zero is its lower bound whichever side it came from.
                    rows.append(sign * (value - bound))
                    lower.append(ca.SX(0.0))
                    upper.append(ca.SX(np.inf))
                    origins.append(_Origin(label, is_row, index, sign))
                    own[side] = ca.SX(-sign * np.inf)
            if is_row and not all(
                ca.is_equal(end, ca.SX(far)) for end, far in zip(own, (-np.inf, np.inf), strict=True)
            ):
                rows.append(value)
                lower.append(own[0])
                upper.append(own[1])
                origins.append(_Origin(label, is_row, index, 1.0))
    return ca.vertcat(*rows), (ca.vertcat(*lower), ca.vertcat(*upper)), tuple(origins)
