"""The search over an observer's weights: where it begins, its rounds, opened cut shafts, beds that it adds."""
