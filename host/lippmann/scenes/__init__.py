"""Loads scenes (Mitsuba's XML, meshes, splats, quilts, views, depth pictures); places them."""
