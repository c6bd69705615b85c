"""Reading logs: a format gives named fields, `meaning` says what they are, `align` makes records."""
