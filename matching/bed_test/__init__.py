"""Judges recordings of the controlled bed: does it answer as the match predicted, and as the vehicle does."""
