"""The functions that a program or a notebook calls, and what they return."""
