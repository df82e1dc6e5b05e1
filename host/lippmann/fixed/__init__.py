"""The integer twin: the RTL's fixed point, bit for bit.

All arrays are int64. Each function follows the RTL module of its name, step by step;
both state each rounding as the same formula. rtl/optics/lipp_optics_pkg.sv has formats.
"""
