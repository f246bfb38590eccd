"""The optimal cycle: its program, starts, search, refinement, certificate, and why there is none."""
