"""Foundations that do not depend on displays: files, images, TOML, limits, memory, programs, Mitsuba's variant."""
