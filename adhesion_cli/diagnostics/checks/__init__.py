"""One check per file; `diagnostics.registry` says what a file holds."""
