"""Boards with a panel, real or virtual: protocol, streaming and checks."""
