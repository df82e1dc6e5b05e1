"""Calibration: compute a display file from photographs of a panel behind its array.

The modules in order of use are `coded_patterns`, `shooting`, `photographs`,
`pattern_decoding`, `photograph_diagnostics`, `lattice_search`, `lenslet_measurement`,
`initial_estimate`, `bundle_adjustment`, `subpixel_intervals`, `result` and `check`;
`solve` runs them. `simulated_camera` and `simulated_photographs` simulate photographs.
"""
