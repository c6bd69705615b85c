"""The estimators: one published method per file. What a file holds: `adhesion_cli.estimator`."""

PAPER = (
    "Wu M., Peng S., Li X.: Online estimation algorithm of adhesive force for train wheel-track, "
    "Tongji University"
)
