"""The display in a display file: panel, lens array, sub-pixels and glass."""
