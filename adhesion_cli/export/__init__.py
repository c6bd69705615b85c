"""A method as C99 for a brake control unit, translated from its Python source."""
