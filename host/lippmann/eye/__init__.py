"""What an eye sees: observer, views, the viewer page and the notebook."""
