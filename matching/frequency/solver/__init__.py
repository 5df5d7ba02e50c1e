"""Solving the programme: local searches from many starts, their ends checked, the best finished."""
