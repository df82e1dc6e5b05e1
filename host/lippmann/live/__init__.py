"""A scene on a display, moved by hand while one looks."""
