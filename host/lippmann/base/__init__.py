"""Contains basic functions for files, images, TOML, limits, memory, programs and Mitsuba."""
