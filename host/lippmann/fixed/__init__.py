"""The integer twin computes the fixed-point RTL's results in Python, bit for bit.

All arrays are int64. Each function computes the same formulas as the RTL module of the
same name. rtl/optics/lipp_optics_pkg.sv defines the word formats.
"""
