"""Logs while they grow: the same estimators, sample by sample."""
