"""The link: what brings frames to a board over a serial line, and asks it things (docs/reference/link.md)."""
