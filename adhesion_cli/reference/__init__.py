"""Offline reference adhesion force and its uncertainty."""
