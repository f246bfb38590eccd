"""The limits of the optimal cycle, one row each: the key of the problem file, what it bounds, and its words.

Everything that deals with limits reads these rows: the optimal control problem and its certificate, the report of
active limits and shadow prices, the sentence on limits in conflict, the checks of a problem and of prescribed cycles,
winch laws, pictures (`kiteocp.cycle.limits` has the evaluator). A new limit is a row here.
"""

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from kiteocp.problem.fields import ForcePlace, quantity, text

#: How the number in the file bounds the quantity, beside its unit: ``opposite`` is a positive number that bounds a
#: negative quantity from below, ``magnitude`` bounds from both sides, ``tangent`` is that of the bounded angle.
Measure = Literal["same", "opposite", "magnitude", "tangent"]

PHASES = ("retraction", "transition", "traction", "turn")


class LimitRow(msgspec.Struct, frozen=True):
    """What a key of ``limits`` bounds. Its name says from which side: ``_min`` or ``_max``.

    Attributes
    ----------
    quantity
        The bounded quantity: a place, an output of a flight state (`kiteocp.physics.equilibrium.OUTPUTS`), a control,
        ``tether_force`` where `at` says; of a whole phase ``duration`` or ``stroke``. None where the program has no
        such quantity.
    cannot, needs
        What a kite cannot do within the limit, and what it would need instead; ``{}`` stands for the number.
    more
        What a larger number gives.
    unit
        Of the number in the file.
    measure
        From the number to the bound.
    phases
        Where it holds.
    whole
        Whether it holds for the phase as a whole, and not at every instant.
    rate
        Whether it bounds the rate of the quantity in time.
    rarely
        Phases in which most optima keep it by themselves: the solver looks there only after a first solution.
    at
        Key that says where a tether force is bounded.
    level
        What to call it beside its quantity in a picture, if not ``minimum`` or ``maximum``.
    """

    quantity: str | None
    cannot: str
    needs: str
    more: str
    unit: str
    measure: Measure = "same"
    phases: tuple[str, ...] = PHASES
    whole: bool = False
    rate: bool = False
    rarely: tuple[str, ...] = ()
    at: str | None = None
    level: str | None = None


_ROW_FIELDS = frozenset(LimitRow.__struct_fields__)


def limit(unit: str, meaning: str, of: str | None, *, derived: str | None = None, **row_and_bounds: Any) -> Meta:
    """Describe a limit of the problem file: a number, and its `LimitRow`.

    Parameters
    ----------
    unit, meaning, derived
        As in `kiteocp.problem.fields.quantity`.
    of
        The bounded quantity.
    **row_and_bounds
        Attributes of `LimitRow`, and the bounds of the number itself (``gt``, ``ge``, ``lt``, ``le``).
    """
    row = {name: value for name, value in row_and_bounds.items() if name in _ROW_FIELDS}
    bounds = {name: value for name, value in row_and_bounds.items() if name not in _ROW_FIELDS}
    return quantity(unit, meaning, derived=derived, limit=LimitRow(of, unit=unit, **row), **bounds)


class Limits(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the optimal cycle must respect; powers are positive numbers."""

    tether_force_max_N: Annotated[
        float,
        limit(
            "N",
            "largest tether force",
            "tether_force",
            at="limits.tether_force_max_at",
            gt=0,
            rarely=("retraction",),
            cannot="stay below the maximum tether force of {} N",
            needs="a maximum tether force of {} N",
            more="more tether force",
        ),
    ]
    tether_force_min_N: Annotated[
        float,
        limit(
            "N",
            "smallest tether force",
            "tether_force",
            at="limits.tether_force_min_at",
            gt=0,
            derived="3 % of limits.tether_force_max_N",
            rarely=("traction", "turn"),
            cannot="hold the minimum tether force of {} N",
            needs="a minimum tether force of {} N",
            more="more minimum tether force",
        ),
    ]
    tether_force_min_at: Annotated[ForcePlace, text("where the smallest force is kept")] = "ground"
    tether_force_max_at: Annotated[ForcePlace, text("where the largest force is kept")] = "kite"
    reel_in_speed_max_m_s: Annotated[
        float,
        limit(
            "m/s",
            "fastest reel-in, a positive number",
            "reeling_speed",
            measure="opposite",
            gt=0,
            cannot="reel in at no more than {} m/s",
            needs="a reel-in speed of up to {} m/s",
            more="faster reel-in",
            level="reel-in limit",
        ),
    ] = 10.0
    reel_out_speed_max_m_s: Annotated[
        float,
        limit(
            "m/s",
            "fastest reel-out",
            "reeling_speed",
            gt=0,
            cannot="reel out at no more than {} m/s",
            needs="a reel-out speed of up to {} m/s",
            more="faster reel-out",
            level="reel-out limit",
        ),
    ] = 10.0
    reel_out_speed_min_m_s: (
        Annotated[
            float,
            limit(
                "m/s",
                "slowest reel-out in traction, which a generator may need; null is no limit",
                "reeling_speed",
                gt=0,
                phases=("traction",),
                cannot="reel out at {} m/s or more",
                needs="a slowest reel-out of {} m/s",
                more="more minimum reel-out speed",
                level="slowest reel-out",
            ),
        ]
        | None
    ) = None
    reeling_acceleration_max_m_s2: Annotated[
        float,
        limit(
            "m/s2",
            "largest acceleration of the winch inside a phase",
            "reeling_speed",
            measure="magnitude",
            rate=True,
            gt=0,
            rarely=PHASES,
            cannot="change its reeling speed by no more than {} m/s2",
            needs="a winch acceleration of up to {} m/s2",
            more="more winch acceleration",
        ),
    ] = 3.0
    generator_power_max_W: (
        Annotated[
            float,
            limit(
                "W",
                "largest mechanical power in reel-out; null is no limit",
                "power",
                gt=0,
                rarely=("retraction", "transition"),
                cannot="keep to the generator's {} W",
                needs="a generator power of up to {} W",
                more="more generator power",
                level="generator limit",
            ),
        ]
        | None
    ) = None
    motor_power_max_W: (
        Annotated[
            float,
            limit(
                "W",
                "largest mechanical power in reel-in; null is no limit",
                "power",
                measure="opposite",
                gt=0,
                rarely=("retraction", "transition"),
                cannot="keep to the motor's {} W",
                needs="a motor power of up to {} W",
                more="more motor power",
                level="motor limit",
            ),
        ]
        | None
    ) = None
    height_min_m: Annotated[
        float,
        limit(
            "m",
            "lowest flight altitude",
            "height",
            ge=0,
            rarely=PHASES,
            cannot="stay above {} m of altitude",
            needs="a lowest altitude of {} m",
            more="more minimum height",
        ),
    ] = 50.0
    height_max_m: Annotated[
        float,
        limit(
            "m",
            "highest flight altitude",
            "height",
            gt=0,
            rarely=PHASES,
            cannot="stay below {} m of altitude",
            needs="a highest altitude of {} m",
            more="more maximum height",
        ),
    ] = 500.0
    tether_length_min_m: Annotated[
        float,
        limit(
            "m",
            "shortest tether",
            "tether_length",
            gt=0,
            derived="operation.tether_length_min_m",
            cannot="keep its tether longer than {} m",
            needs="a shortest tether of {} m",
            more="more minimum tether length",
        ),
    ]
    tether_length_max_m: Annotated[
        float,
        limit(
            "m",
            "longest tether",
            "tether_length",
            gt=0,
            derived="operation.tether_length_max_m",
            cannot="keep its tether shorter than {} m",
            needs="a longest tether of {} m",
            more="more tether",
        ),
    ]
    traction_elevation_min_deg: Annotated[
        float,
        limit(
            "deg",
            "lowest elevation in traction",
            "elevation",
            gt=0,
            lt=90,
            phases=("traction",),
            cannot="keep its traction above {} deg of elevation",
            needs="a lowest traction elevation of {} deg",
            more="more minimum elevation in traction",
        ),
    ] = 20.0
    traction_elevation_max_deg: Annotated[
        float,
        limit(
            "deg",
            "highest elevation in traction",
            "elevation",
            gt=0,
            lt=90,
            phases=("traction",),
            cannot="keep its traction below {} deg of elevation",
            needs="a highest traction elevation of {} deg",
            more="more maximum elevation in traction",
            level="traction max",
        ),
    ] = 60.0
    elevation_max_deg: Annotated[
        float,
        limit(
            "deg",
            "highest elevation in all phases; beyond 90 the kite is upwind",
            "elevation",
            gt=0,
            le=180,
            phases=("retraction", "transition", "turn"),
            cannot="stay below {} deg of elevation",
            needs="a highest elevation of {} deg",
            more="more maximum elevation",
        ),
    ] = 85.0
    traction_duration_min_s: Annotated[
        float,
        limit(
            "s",
            "shortest traction; one figure of eight takes about 20 s",
            "duration",
            whole=True,
            ge=0,
            phases=("traction",),
            cannot="reel out for at least {} s",
            needs="a shortest traction of {} s",
            more="more minimum duration of the traction",
        ),
    ] = 20.0
    stroke_min_m: (
        Annotated[
            float,
            limit(
                "m",
                "shortest length reeled out in traction; null is no limit",
                "stroke",
                whole=True,
                gt=0,
                phases=("traction",),
                cannot="reel out by at least {} m",
                needs="a smallest stroke of {} m",
                more="more minimum stroke",
            ),
        ]
        | None
    ) = None
    traction_elevation_rate_max_deg_s: Annotated[
        float,
        limit(
            "deg/s",
            "fastest change of the elevation in traction where it is free",
            "elevation_rate",
            measure="magnitude",
            gt=0,
            phases=("traction",),
            cannot="change its elevation in traction by no more than {} deg/s",
            needs="an elevation rate of up to {} deg/s in traction",
            more="faster change of elevation in traction",
        ),
    ] = 0.1
    apparent_wind_speed_max_m_s: (
        Annotated[
            float,
            limit(
                "m/s",
                "largest apparent wind speed that the kite's structure bears; null is no limit",
                "apparent_wind_speed",
                gt=0,
                cannot="keep its apparent wind speed below {} m/s",
                needs="an apparent wind speed of up to {} m/s",
                more="more apparent wind speed",
            ),
        ]
        | None
    ) = None
    retraction_duration_min_s: Annotated[
        float,
        limit(
            "s",
            "shortest retraction",
            "duration",
            whole=True,
            gt=0,
            phases=("retraction",),
            cannot="reel in for at least {} s",
            needs="a shortest retraction of {} s",
            more="more minimum duration of the retraction",
        ),
    ] = 0.5
    transition_duration_min_s: Annotated[
        float,
        limit(
            "s",
            "shortest transition",
            "duration",
            whole=True,
            gt=0,
            phases=("transition",),
            cannot="fly a transition of at least {} s",
            needs="a shortest transition of {} s",
            more="more minimum duration of the transition",
        ),
    ] = 0.2
    turn_duration_min_s: Annotated[
        float,
        limit(
            "s",
            "shortest turn, where optimisation.turn is flown; less than 1 ms counts as 1 ms",
            "duration",
            whole=True,
            ge=0,
            phases=("turn",),
            cannot="fly a turn of at least {} s",
            needs="a shortest turn of {} s",
            more="more minimum duration of the turn",
        ),
    ] = 0.001
    phase_duration_max_s: Annotated[
        float,
        limit(
            "s",
            "longest retraction, transition, traction and turn",
            "duration",
            whole=True,
            gt=0,
            cannot="finish each phase within {} s",
            needs="phases of up to {} s",
            more="more time for each phase",
        ),
    ] = 3600.0
    radial_ground_force_min_N: Annotated[
        float,
        limit(
            "N",
            "smallest pull along the line from winch to kite; below 0 the tether would push",
            "radial_ground_force",
            ge=0,
            cannot="keep a radial pull of {} N at the ground",
            needs="a smallest radial pull at the ground of {} N",
            more="more minimum radial force at the ground",
        ),
    ] = 0.0
    kinematic_ratio_min: Annotated[
        float,
        limit(
            "1",
            "smallest kinematic ratio; near 0 the kite is too heavy for the wind and falls",
            "inflow_angle",
            measure="tangent",
            gt=0,
            cannot="keep its kinematic ratio above {}",
            needs="a smallest kinematic ratio of {}",
            more="more minimum kinematic ratio",
        ),
    ] = 0.03
    kinematic_ratio_max: Annotated[
        float,
        limit(
            "1",
            "largest kinematic ratio; beyond, the kite outruns its tether, which goes slack",
            "inflow_angle",
            measure="tangent",
            gt=0,
            cannot="keep its kinematic ratio below {}",
            needs="a largest kinematic ratio of {}",
            more="more maximum kinematic ratio",
        ),
    ] = 200.0
    forward_airspeed_ratio_min: Annotated[
        float,
        limit(
            "1",
            "smallest airspeed along the course in traction over wind speed; at 0 steady flight ends",
            "forward_airspeed_ratio",
            ge=0,
            phases=("traction",),
            rarely=("traction",),
            cannot="keep an airspeed along its course of {} times the wind speed",
            needs="a smallest airspeed along the course of {} times the wind speed",
            more="more minimum airspeed along the course, in wind speeds,",
        ),
    ] = 0.03
    traction_course_min_deg: Annotated[
        float,
        limit(
            "deg",
            "lowest course in traction where it is coupled to the elevation; 0 is down",
            "course",
            ge=0,
            le=180,
            phases=("traction",),
            cannot="keep its course in traction above {} deg",
            needs="a lowest traction course of {} deg",
            more="more minimum course in traction",
        ),
    ] = 0.0
    traction_course_max_deg: Annotated[
        float,
        limit(
            "deg",
            "highest course in traction where it is coupled to the elevation; 180 is up",
            "course",
            ge=0,
            le=180,
            phases=("traction",),
            cannot="keep its course in traction below {} deg",
            needs="a highest traction course of {} deg",
            more="more maximum course in traction",
        ),
    ] = 180.0
    power_setting_min: Annotated[
        float,
        limit(
            "1",
            "lowest power setting where it is free; 0 is kite.depowered",
            "power_setting",
            ge=0,
            le=1,
            cannot="keep its power setting above {}",
            needs="a lowest power setting of {}",
            more="more minimum power setting",
        ),
    ] = 0.0
    power_setting_max: Annotated[
        float,
        limit(
            "1",
            "highest power setting where it is free; 1 is kite.powered",
            "power_setting",
            ge=0,
            le=1,
            cannot="keep its power setting below {}",
            needs="a highest power setting of {}",
            more="more maximum power setting",
        ),
    ] = 1.0
    phase_change_time_s: Annotated[
        float,
        limit(
            "s",
            "time without power at each of the three phase changes",
            None,
            ge=0,
            cannot="change phase in {} s",
            needs="a phase-change time of {} s",
            more="more time for each phase change",
        ),
    ] = 2.0
