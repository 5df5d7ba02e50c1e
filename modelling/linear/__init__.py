"""Linearisation, steady motion and state space."""
