"""Results on disk: written whole, moved together, what is outdated removed."""
