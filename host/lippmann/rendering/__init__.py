"""From a scene and a display to an integral image, on Mitsuba 3."""
