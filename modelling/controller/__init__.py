"""The sampled controller as it leaves the computer: its law, its supervision, its C sources."""
