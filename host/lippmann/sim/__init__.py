"""Around Verilator: the RTL compiled and run from Python."""
