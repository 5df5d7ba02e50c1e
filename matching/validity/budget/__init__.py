"""Uncertainty budgets: measurands with formulas, inputs with distributions, and their TOML files."""
