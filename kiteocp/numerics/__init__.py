"""Numerical methods that know nothing of kites."""
