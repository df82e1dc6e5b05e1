"""Boards with a panel, real or virtual: link protocol, frame streaming and checks."""
