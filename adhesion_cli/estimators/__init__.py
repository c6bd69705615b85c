"""The estimators: one published method per file. What a file holds: `adhesion_cli.estimator`."""
