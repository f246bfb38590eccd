"""The blocks of the problem file that say how the system is flown, within what limits and how it is optimised.

Defaults that follow from other keys (``derived``) are filled in by `kiteocp.problem.defaults` before these structures
are built, so that a loaded problem has a number for every key.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Struct

from kiteocp.problem.fields import quantity, section, text

ForcePlace = Literal["kite", "ground"]


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


class Operation(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The prescribed cycle of the forward simulation."""

    force_reference: Annotated[ForcePlace, text("where the prescribed tether forces act")] = "kite"
    tether_length_min_m: Annotated[float, quantity("m", "tether length at which retraction ends", gt=0)] = 200.0
    tether_length_max_m: Annotated[float, quantity("m", "tether length at which traction ends", gt=0)] = 400.0
    traction: Annotated[TractionOperation, section("reel-out", derived="the defaults of its keys")]
    retraction: Annotated[RetractionOperation, section("reel-in", derived="the defaults of its keys")]


class Limits(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the optimal cycle must respect; powers are positive numbers."""

    tether_force_min_N: Annotated[
        float, quantity("N", "smallest tether force", gt=0, derived="3 % of limits.tether_force_max_N")
    ]
    tether_force_max_N: Annotated[float, quantity("N", "largest tether force", gt=0)]
    tether_force_min_at: Annotated[ForcePlace, text("where the smallest force is kept")] = "ground"
    tether_force_max_at: Annotated[ForcePlace, text("where the largest force is kept")] = "kite"
    reel_in_speed_max_m_s: Annotated[float, quantity("m/s", "fastest reel-in, a positive number", gt=0)] = 10.0
    reel_out_speed_max_m_s: Annotated[float, quantity("m/s", "fastest reel-out", gt=0)] = 10.0
    reeling_acceleration_max_m_s2: Annotated[
        float, quantity("m/s2", "largest acceleration of the winch inside a phase", gt=0)
    ] = 3.0
    generator_power_max_W: (
        Annotated[float, quantity("W", "largest mechanical power in reel-out; null is no limit", gt=0)] | None
    ) = None
    motor_power_max_W: (
        Annotated[float, quantity("W", "largest mechanical power in reel-in; null is no limit", gt=0)] | None
    ) = None
    height_min_m: Annotated[float, quantity("m", "lowest flight altitude", ge=0)] = 50.0
    height_max_m: Annotated[float, quantity("m", "highest flight altitude", gt=0)] = 500.0
    tether_length_min_m: Annotated[
        float, quantity("m", "shortest tether", gt=0, derived="operation.tether_length_min_m")
    ]
    tether_length_max_m: Annotated[
        float, quantity("m", "longest tether", gt=0, derived="operation.tether_length_max_m")
    ]
    traction_elevation_min_deg: Annotated[float, quantity("deg", "lowest elevation in traction", gt=0, lt=90)] = 20.0
    traction_elevation_max_deg: Annotated[float, quantity("deg", "highest elevation in traction", gt=0, lt=90)] = 60.0
    elevation_max_deg: Annotated[
        float, quantity("deg", "highest elevation in all phases; beyond 90 the kite is upwind", gt=0, le=180)
    ] = 85.0
    traction_duration_min_s: Annotated[
        float, quantity("s", "shortest traction; one figure of eight takes about 20 s", ge=0)
    ] = 20.0
    stroke_min_m: (
        Annotated[float, quantity("m", "shortest length reeled out in traction; null is no limit", gt=0)] | None
    ) = None
    traction_elevation_rate_max_deg_s: Annotated[
        float, quantity("deg/s", "fastest change of the elevation in traction where it is free", gt=0)
    ] = 0.1
    retraction_duration_min_s: Annotated[float, quantity("s", "shortest retraction", gt=0)] = 0.5
    transition_duration_min_s: Annotated[float, quantity("s", "shortest transition", gt=0)] = 0.2
    phase_duration_max_s: Annotated[float, quantity("s", "longest retraction, transition and traction", gt=0)] = 3600.0
    radial_ground_force_min_N: Annotated[
        float, quantity("N", "smallest pull along the line from winch to kite; below 0 the tether would push", ge=0)
    ] = 0.0
    kinematic_ratio_min: Annotated[
        float,
        quantity("1", "smallest kinematic ratio; near 0 the kite is too heavy for the wind and falls", gt=0),
    ] = 0.03
    kinematic_ratio_max: Annotated[
        float, quantity("1", "largest kinematic ratio; beyond, the kite outruns its tether, which goes slack", gt=0)
    ] = 200.0
    forward_airspeed_ratio_min: Annotated[
        float,
        quantity("1", "smallest airspeed along the course in traction over wind speed; at 0 steady flight ends", ge=0),
    ] = 0.03
    traction_course_min_deg: Annotated[
        float,
        quantity("deg", "lowest course in traction where it is coupled to the elevation; 0 is down", ge=0, le=180),
    ] = 0.0
    traction_course_max_deg: Annotated[
        float,
        quantity("deg", "highest course in traction where it is coupled to the elevation; 180 is up", ge=0, le=180),
    ] = 180.0
    power_setting_min: Annotated[
        float, quantity("1", "lowest power setting where it is free; 0 is kite.depowered", ge=0, le=1)
    ] = 0.0
    power_setting_max: Annotated[
        float, quantity("1", "highest power setting where it is free; 1 is kite.powered", ge=0, le=1)
    ] = 1.0
    phase_change_time_s: Annotated[
        float, quantity("s", "time without power at each of the three phase changes", ge=0)
    ] = 2.0


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
