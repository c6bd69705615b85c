"""The estimators: one published method per file; `core.estimator` says what a file holds."""

PAPER = (
    "Wu M., Peng S., Li X.: Online estimation algorithm of adhesive force for train wheel-track, "
    "Tongji University"
)
HAN = (
    "Han J.: From PID to active disturbance rejection control, "
    "IEEE Transactions on Industrial Electronics 56 (2009) 900-906"
)
