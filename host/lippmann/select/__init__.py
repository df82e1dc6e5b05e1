"""Chooses the cheapest lens model, and the cheapest fixed-point build, that stay within a tolerance."""
