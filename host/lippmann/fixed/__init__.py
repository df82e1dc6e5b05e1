"""The integer twin computes the fixed-point RTL's results in Python, bit for bit.

All arrays are int64. Each function follows the RTL module of the same name; both state
each rounding as the same formula. rtl/optics/lipp_optics_pkg.sv defines the formats.
"""
