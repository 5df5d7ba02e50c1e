"""Curves of a match as data to calculate with, and as figures that act in the browser."""
