"""Measurement uncertainty after the GUM (Eqs. 9–12)."""
