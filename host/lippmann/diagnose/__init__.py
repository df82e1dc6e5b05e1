"""Compares foreign rays with the truth and names the fault that explains the difference."""
