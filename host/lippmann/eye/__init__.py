"""Computes and shows what an eye sees on a display."""
