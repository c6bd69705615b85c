"""Wheel-slide protection: plant, scenarios, controllers, closed loop."""
