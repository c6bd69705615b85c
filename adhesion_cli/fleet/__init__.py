"""Many logs: found, analysed by several processes or a cluster, kept as tables."""
