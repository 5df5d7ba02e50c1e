"""Output-error fits of a model to recordings, their uncertainty, and how they predict held-out data."""
