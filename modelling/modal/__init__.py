"""Modes, energy shares and sensitivities (Eqs. 1–8)."""
