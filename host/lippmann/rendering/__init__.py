"""Renders the integral image of a scene for a display, with Mitsuba 3."""
