"""The blocks of the problem file that say how the system is flown, within what limits and how it is optimised.

Defaults that follow from other keys (``derived``) are filled in by `kiteocp.problem.defaults` before these structures
are built, so that a loaded problem has a number for every key.
"""

from typing import Annotated, Literal

from msgspec import Struct

from kiteocp.problem.fields import ForcePlace, quantity, section, text


class TractionOperation(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The prescribed traction phase."""

    elevation_deg: Annotated[float, quantity("deg", "mean elevation angle", gt=0, lt=90)] = 27.0
    azimuth_deg: Annotated[float, quantity("deg", "mean azimuth angle from downwind", gt=-90, lt=90)] = 12.0
    course_deg: Annotated[float, quantity("deg", "mean course angle, 0 down and 180 up", ge=-360, le=360)] = 100.0
    tether_force_N: Annotated[
        float, quantity("N", "tether force held by the winch", gt=0, derived="limits.tether_force_max_N")
    ]


class RetractionOperation(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The prescribed retraction phase."""

    tether_force_N: Annotated[
        float,
        quantity(
            "N",
            "tether force held by the winch",
            gt=0,
            derived="25 % of limits.tether_force_max_N, not below limits.tether_force_min_N",
        ),
    ]


class TurnOperation(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The prescribed turn from traction to retraction, a powered climb, where ``optimisation.turn`` is ``flown``."""

    tether_force_N: Annotated[
        float, quantity("N", "tether force held by the winch", gt=0, derived="operation.traction.tether_force_N")
    ]
    elevation_deg: Annotated[
        float,
        quantity(
            "deg",
            "elevation angle at which the turn ends",
            gt=0,
            le=180,
            derived="15 deg above operation.traction.elevation_deg",
        ),
    ]


class Operation(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The prescribed cycle of the forward simulation."""

    force_reference: Annotated[ForcePlace, text("where the prescribed tether forces act")] = "kite"
    tether_length_min_m: Annotated[float, quantity("m", "tether length at which retraction ends", gt=0)] = 200.0
    tether_length_max_m: Annotated[float, quantity("m", "tether length at which traction ends", gt=0)] = 400.0
    traction: Annotated[TractionOperation, section("reel-out", derived="the defaults of its keys")]
    retraction: Annotated[RetractionOperation, section("reel-in", derived="the defaults of its keys")]
    turn: Annotated[TurnOperation, section("powered climb after reel-out", derived="the defaults of its keys")]


class Machine(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The ground station's electrical machine."""

    generator_efficiency: Annotated[
        float, quantity("1", "electrical over mechanical power in reel-out", gt=0, le=1)
    ] = 1.0
    motor_efficiency: Annotated[float, quantity("1", "mechanical over electrical power in reel-in", gt=0, le=1)] = 1.0


class Mesh(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Collocation mesh of the optimal control problem."""

    retraction_intervals: Annotated[
        int,
        quantity(
            "1", "intervals of the retraction phase", ge=1, le=200, derived="3; 4 with optimisation.power_setting: all"
        ),
    ]
    transition_intervals: Annotated[int, quantity("1", "intervals of the transition phase", ge=1, le=200)] = 2
    traction_intervals: Annotated[
        int,
        quantity(
            "1",
            "intervals of the traction phase",
            ge=1,
            le=200,
            derived="1 for a constant elevation and a fixed power setting, 8 for a course-coupled elevation, else 4",
        ),
    ]
    turn_intervals: Annotated[int, quantity("1", "intervals of the turn", ge=1, le=200)] = 2
    degree: Annotated[int, quantity("1", "Radau points of an interval", ge=1, le=9)] = 5


class Optimisation(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is optimised, with what freedom and how accurately."""

    objective: Annotated[Literal["mechanical", "electrical"], text("which mean cycle power is maximised")] = (
        "mechanical"
    )
    traction_elevation: Annotated[
        Literal["constant", "linear", "course-coupled", "free"], text("how the elevation may change in traction")
    ] = "constant"
    power_setting: Annotated[Literal["fixed", "traction", "all"], text("where the kite may be partly depowered")] = (
        "fixed"
    )
    turn: Annotated[
        Literal["none", "flown"],
        text("whether the kite climbs under power between traction and retraction, as a phase of its own"),
    ] = "none"
    speed_jumps: Annotated[
        Literal["free", "limited"],
        text("whether the reeling speed may jump between phases by more than the winch can do meanwhile"),
    ] = "free"
    equilibrium: Annotated[
        Literal["implicit", "explicit"],
        text("whether the force equilibrium is a constraint with an unknown, or its closed form"),
    ] = "implicit"
    tolerance: Annotated[float, quantity("1", "convergence tolerance of the solver", gt=0, le=0.01)] = 1e-8
    max_iterations: Annotated[int, quantity("1", "most iterations of the solver for one start", ge=1)] = 300
    mesh: Annotated[Mesh, section("collocation mesh", derived="the defaults of its keys")]
