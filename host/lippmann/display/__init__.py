"""Describes a display: panel, lens array, sub-pixels and glass."""
