"""Slip, creep curve, slope, regions and the fit of a rail."""
