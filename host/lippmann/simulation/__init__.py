"""Compiles the RTL with Verilator, runs the RTL from Python, and starts virtual boards."""
