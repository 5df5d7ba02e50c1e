"""Lagrange's equations, derived with SymPy and compiled with CasADi."""
