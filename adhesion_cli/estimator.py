"""What an online estimator is, and which ones there are.

An estimator is one file in `estimators/`: `Params` and `State` (NamedTuples, every field
annotated with a `Quantity`), two pure functions and one `ABOUT` record. Plain Python; the same
`step` runs sample by sample online and compiled over whole logs (`compiled.batch`).
"""
