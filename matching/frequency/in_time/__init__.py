"""The tuned controller as it runs, on beds that are not the model, beside the nonlinear vehicle."""
