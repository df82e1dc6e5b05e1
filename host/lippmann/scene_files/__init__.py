"""Scenes in the files of other tools, written as Mitsuba's XML."""
