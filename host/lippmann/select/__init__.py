"""Chooses the cheapest lens model, and the cheapest fixed-point build, within a tolerance."""
