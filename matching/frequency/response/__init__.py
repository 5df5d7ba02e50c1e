"""Responses of a tuned bed with its sampled controller, and how far they are from the vehicle's."""
