"""Compiles the RTL with Verilator, runs it from Python, and starts virtual boards."""
