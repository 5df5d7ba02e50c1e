"""What every room needs: errors, strict TOML tables, how results are displayed, files written whole."""
