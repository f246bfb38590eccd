"""A small optimal control problem that has one of everything, for tests of what is made of any problem."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from kiteocp.ocp.collocation import PhaseMesh
from kiteocp.ocp.declaration import (
    Link,
    OptimalControlProblem,
    PathConstraint,
    Phase,
    Point,
    PointExpressions,
    RateLimit,
    Residual,
    Static,
    Variable,
)
from kiteocp.ocp.trajectory import Guess, PhaseGuess

MESHES = {"out": PhaseMesh(3, (0.3, 0.7)), "home": PhaseMesh.uniform(1, 2)}
P = (0.5, 3.0)


def there_and_back() -> OptimalControlProblem:
    """A vehicle with drag that goes out and comes home: states, an algebraic, a control, a static, all scaled."""
    p = ca.SX.sym("p", 2)  # drag, limit of speed
    effort = Static("effort", 0.1, 2.0, scale=0.5)

    def phase(name: str, direction: float) -> Phase:
        def model(q: Point) -> PointExpressions:
            return PointExpressions(
                {"x": q["v"], "v": effort.symbol * q["a"] - q["drag"]},
                [Residual("drag law", q["drag"] - p[0] * q["v"] * ca.sqrt(q["v"] ** 2 + 0.01), 2.0)],
                [PathConstraint("speed", direction * q["v"], -p[1], p[1], 4.0)],
                {"power": effort.symbol * q["a"] * q["v"], "clock": q.time / q.duration},
            )

        return Phase(
            name,
            duration=Variable("duration", 0.5, 20.0, 5.0),
            states=[Variable("x", scale=10.0), Variable("v", scale=2.0)],
            algebraics=[Variable("drag", scale=3.0)],
            controls=[Variable("a", -1.0, 1.0)],
            rate_limits=[RateLimit("jerk", "a", -0.8, 0.8, 0.4)],
            model=model,
        )

    out, home = phase("out", 1.0), phase("home", -1.0)
    links = [Link(f"start {n}", out.start[n]) for n in ("x", "v")]
    links += [Link(f"turn {n}", out.end[n] - home.start[n], scale=3.0) for n in ("x", "v")]
    links += [Link("far", out.end["x"], 2.0, math.inf, 10.0), Link("home", home.end["x"]), Link("rest", home.end["v"])]
    time = out.duration + home.duration
    return OptimalControlProblem([out, home], time + 0.1 * effort.symbol**2, links, [effort], p)


GUESS = Guess(
    {
        "out": PhaseGuess(
            4.0, {"x": lambda s: 2.0 * s, "v": 0.5, "drag": lambda s: 0.1 * s, "a": np.linspace(1, -1, 6)}
        ),
        "home": PhaseGuess(4.0, {"x": [2.0, 1.0, 0.0], "v": -0.5, "drag": [-0.1, 0.1], "a": 0.2}),
    },
    {"effort": 1.5},
)
