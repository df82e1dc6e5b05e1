"""Foundations that know nothing of displays: files, images, TOML, limits, memory, programs, Mitsuba's variant."""
