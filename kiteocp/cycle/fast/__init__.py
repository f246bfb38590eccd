"""Many prescribed cycles at once, and their derivatives: special cases of the simulation, for speed."""
