"""Validation against the paper's results section: tables, convergence, isolines of mass, report."""
