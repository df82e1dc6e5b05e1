"""The integer twin: the RTL's fixed point, bit for bit.

All arrays are int64. Each function follows the RTL module of its name, step by step: the module's header has the
formula with every rounding. rtl/optics/lipp_optics_pkg.sv has the formats.
"""
