"""Scenes (Mitsuba's XML, meshes, splats, quilts, views, depth pictures) and placements."""
