"""What the optimal power is worth in every number: derivatives, variations, uncertainties."""
