"""Aerodynamics and wind from flight data (sections 3.3 and 3.4 of the paper, and the model's own equilibrium).

`study.estimate` does all of it; `wind`, `inversion`, `fit`, `averages` and `synthetic` are its parts, of use alone too.
"""
