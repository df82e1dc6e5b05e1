"""The integer twin: the RTL's fixed point, bit for bit, one file for each RTL module of the same name.

Integers only, int64 arrays. Every rounding is written as an integer formula, here and in the RTL module; formats and
words are those of rtl/optics/optics_pkg.sv.
"""
