"""The RTL compiled by Verilator and run from Python, and the process of the virtual board."""
