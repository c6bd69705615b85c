"""A log to one record per axle: screen, resample, synchronise."""
