"""What a model gets wrong, from recordings."""
