"""Measured flights, predicted by the model and compared with it."""
