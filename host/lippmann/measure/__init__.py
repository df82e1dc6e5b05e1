"""Measurements of speed and error. Each module returns rows; `lippmann.report` writes pages of them."""
