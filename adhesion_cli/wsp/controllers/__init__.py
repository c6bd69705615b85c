"""The controllers: one law per file. What a file holds: `adhesion_cli.wsp.controller`."""
