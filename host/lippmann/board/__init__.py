"""A board with a panel: protocol, streaming, checks; the same calls for a real board and the virtual one."""
