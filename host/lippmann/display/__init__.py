"""What a display file describes: panel, lens array, sub-pixels and glass."""
