"""The integer twin: the RTL's fixed point, bit for bit, one file for each RTL module of the same name.

All arrays are int64. Each rounding is written as an integer formula, here and in the RTL module; the formats and words
are those of rtl/optics/lipp_optics_pkg.sv.
"""
