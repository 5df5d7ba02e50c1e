"""Beds drawn from what is not known exactly, and what a sampled controller does on them: the search's own assembly."""
