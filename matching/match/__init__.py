"""Matching the rig to the vehicle."""
