"""Data model, physics, units, method registry, compiled loops: what every package may use."""
