"""Converts scenes to stacks of textured layers, which an FPGA draws without a frame memory."""
