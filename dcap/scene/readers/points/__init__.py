"""Point clouds: recognition and reading of their files."""
