"""Frequency responses of the compared functions, and their errors."""
