"""Reading logs: formats give named fields, `meaning` says what they are, `align` makes records."""
