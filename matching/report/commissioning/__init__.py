"""How a commissioning is written."""
