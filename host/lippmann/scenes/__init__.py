"""Reading scenes (Mitsuba's XML, meshes, splats, quilts, views, depth pictures), and their placement."""
