"""Calibration: photographs of a panel behind its mounted array become a display file.

The work in order: `coded_patterns` (what the panel shows), `shooting`, `photographs`,
`pattern_decoding` with `photograph_diagnostics`, `lattice_search`,
`lenslet_measurement`, `initial_estimate`, `bundle_adjustment` by exact rays of
`lens_projection`, `subpixel_intervals`, `solve` (all of it), `result`, `check`.
`simulated_camera` and `simulated_photographs` compute photographs.
"""
