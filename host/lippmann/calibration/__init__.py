"""Calibration: photographs of a panel behind its mounted array become a display file.

The modules in the order of the work: `codes` (what the panel shows), `shoot`, `photographs`, `decode` (the panel point
that each camera pixel sees), `lattice`, `outline` and `lenslets` (the panel point seen through each lenslet), `landing`
(where the lenslet's optics bring a ray), `camera` and `bundle` (the least squares), `result`, `check`.
"""
