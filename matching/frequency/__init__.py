"""Rig → vehicle: case, weights, problem, solution, verification, map."""
