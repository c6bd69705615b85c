"""How well an estimator follows truth or reference."""
