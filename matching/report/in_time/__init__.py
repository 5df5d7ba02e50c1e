"""What the tuned controller does in time, on beds that are not the model: lines and tables."""
