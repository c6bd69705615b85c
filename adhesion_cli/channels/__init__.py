"""What a field means: meaning, axle, unit, time axis; a log in SI."""
