"""Log formats: bytes to named numeric fields, with everything lost on the way."""
