"""Scenes as they are read: Mitsuba's XML, meshes, splats, quilts, views and depth pictures, and their placement."""
