"""Candidates for a cause: what the residual could contain of each, and fits of the model extended by one of them."""
