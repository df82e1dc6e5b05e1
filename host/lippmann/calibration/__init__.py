"""Calibration: photographs of a panel behind its mounted array become a display file.

The steps in order are `coded_patterns` (pictures on the panel), `shooting`,
`photographs`, `pattern_decoding` with `photograph_diagnostics`, `lattice_search`,
`lenslet_measurement`, `initial_estimate`, `bundle_adjustment` with exact rays from
`lens_projection`, `subpixel_intervals`, `solve` (runs the steps), `result`, `check`.
`simulated_camera` and `simulated_photographs` simulate photographs.
"""
