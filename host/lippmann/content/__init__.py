"""Pictures in the forms of other tools: views from many eyes, quilts, depth."""
