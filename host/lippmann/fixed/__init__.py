"""The integer twin: the RTL's fixed point, bit for bit, one file for each RTL module of the same name.

All arrays are int64. Each rounding is written as an integer formula, here and in the RTL module: words are integers
there, a b >> k is the product that `multiplier` cuts by k places, and M = 2^(F+3) - 1. The formats and words are those
of rtl/optics/lipp_optics_pkg.sv.
"""
