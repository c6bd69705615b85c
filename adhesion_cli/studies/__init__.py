"""What looks at many runs: the paper reproduced, tuning, calibration, frequency response."""
