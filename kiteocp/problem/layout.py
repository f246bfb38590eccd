"""The layout of the problem file as one structure: what `Problem` adds its reading, checks and defaults to."""

from typing import Annotated

import msgspec
from msgspec import Struct

from kiteocp.problem.fields import section, text
from kiteocp.problem.limits import Limits
from kiteocp.problem.settings import Machine, Operation, Optimisation
from kiteocp.problem.system import Environment, Kite, Tether
from kiteocp.problem.uncertainty import Uncertainty

# The name becomes a directory name under results/, on any system.
NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9._-]*$"


class ProblemLayout(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A pumping kite power system, how it is flown and what its optimal cycle must respect."""

    name: Annotated[
        str, text("name of the problem: letters, digits, '.', '_' and '-'", pattern=NAME_PATTERN, max_length=100)
    ]
    description: Annotated[str, text("what the problem describes, in a line")] = ""
    source: Annotated[str, text("where the numbers come from")] = ""
    environment: Annotated[Environment, section("wind, air and gravity")]
    kite: Annotated[Kite, section("the kite with its control unit")]
    tether: Annotated[Tether, section("the tether")]
    operation: Annotated[
        Operation, section("the prescribed cycle of the forward simulation", derived="the defaults of its keys")
    ]
    limits: Annotated[Limits, section("what the optimal cycle must respect")]
    machine: Annotated[Machine, section("the ground station's electrical machine")] = msgspec.field(
        default_factory=Machine
    )
    optimisation: Annotated[Optimisation, section("what is optimised, and how", derived="the defaults of its keys")]
    uncertainty: Annotated[dict[str, Uncertainty], section("how far numbers of this file may be off, by key path")] = (
        msgspec.field(default_factory=dict)
    )
