"""Computes and shows the views of an eye: observer, viewer page and notebook."""
