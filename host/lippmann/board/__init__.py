"""A board with a panel: protocol, streaming and checks, the same for real boards and the virtual board."""
