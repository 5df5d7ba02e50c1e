"""The program in the browser."""
