"""Foundations without displays: files, images, TOML, limits, memory, programs, Mitsuba's variant."""
