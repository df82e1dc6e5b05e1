"""Calibration: photographs of a panel behind its mounted array become a display file.

The modules in the order of the work: `coded_patterns` (what the panel shows), `shooting`, `photographs`,
`pattern_decoding` (the panel point that each camera pixel sees) with `diagnostics`, `lattice_search` and
`lenslet_measurement` (the panel point seen through each lenslet), `lens_projection` (where the lenslet's optics bring a
ray), `initial_estimate` and `bundle_adjustment` (the least squares), `subpixel_intervals`, `solve` (all of it),
`result`, `check`. `simulated_camera` and `simulated_photographs` take the photographs by computation.
"""
