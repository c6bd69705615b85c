"""One log from settings to results: what the commands run."""
