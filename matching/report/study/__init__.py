"""The page of a study: one frame for map, tolerances, fidelity and uncertainty."""
