"""Views of simulations and frequency responses."""
