"""Measurements against peers and over many made faults."""
