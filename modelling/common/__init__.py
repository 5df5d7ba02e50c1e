"""What every room needs: errors, strict TOML tables, how results are displayed, interruption."""
