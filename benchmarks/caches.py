"""Forgetting what kiteocp has built, to measure the building."""

from __future__ import annotations

import sys


def clear_caches() -> None:
    """Empty every function cache of the package: functions, programs and solvers are built anew."""
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] == "kiteocp":
            for value in list(vars(module).values()):
                # Not the attribute of a class that only happens to have it: a cached function of the module itself.
                if getattr(value, "__module__", None) == name and hasattr(value, "cache_clear"):
                    value.cache_clear()
