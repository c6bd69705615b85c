"""Wheel-rail adhesion from brake-cylinder pressure and wheel speed."""

__version__ = "0.1.0"
