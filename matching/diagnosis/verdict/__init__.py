"""What a search has found, judged on held-out data: confidence, values, evidence, and what to record next."""
