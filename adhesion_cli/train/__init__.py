"""The train's longitudinal model, and speeds on one even time axis."""
