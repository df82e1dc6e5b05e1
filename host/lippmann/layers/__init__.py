"""Scenes as stacks of textured layers at depths: what an FPGA draws without a frame memory."""
