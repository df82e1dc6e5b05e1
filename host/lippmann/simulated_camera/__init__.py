"""Photographs of a display that are computed: by our tracer, or by POV-Ray from glass solids."""
