"""Measurement uncertainty of a budget file after the GUM: propagation, Monte Carlo (JCGM 101), and the inverse."""
