"""The problem file: its keys, reading and checking it, and the shipped problems.

`load_problem` gives a `Problem`, checked and complete; everything else in kiteocp starts from one.
"""

from kiteocp.problem.json_schema import json_schema
from kiteocp.problem.limits import Limits
from kiteocp.problem.overrides import parse_override
from kiteocp.problem.problem import Origin, Problem, load_problem, problem_from_dict
from kiteocp.problem.settings import Machine, Mesh, Operation, Optimisation
from kiteocp.problem.shipped import problem_path, shipped_problems
from kiteocp.problem.system import Aerodynamics, Air, Environment, Kite, Tether
from kiteocp.problem.template import problem_template
from kiteocp.problem.uncertainty import Uncertainty
from kiteocp.problem.wind import LogarithmicWind, PowerLawWind, TableWind, UniformWind, Wind

__all__ = [
    "Aerodynamics",
    "Air",
    "Environment",
    "Kite",
    "Limits",
    "LogarithmicWind",
    "Machine",
    "Mesh",
    "Operation",
    "Optimisation",
    "Origin",
    "PowerLawWind",
    "Problem",
    "TableWind",
    "Tether",
    "Uncertainty",
    "UniformWind",
    "Wind",
    "json_schema",
    "load_problem",
    "parse_override",
    "problem_from_dict",
    "problem_path",
    "problem_template",
    "shipped_problems",
]
