"""Renders films and live pictures."""
