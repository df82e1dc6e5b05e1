"""Simulates the founding paper's single-stage capture by lens, microlens array and camera."""
