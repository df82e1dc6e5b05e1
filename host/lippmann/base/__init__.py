"""Foundations: files, images, TOML, limits, memory, programs, Mitsuba's variant."""
