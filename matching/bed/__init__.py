"""On the bed: excite, identify, verify, commission."""
