"""`dcap drop`: physics cases from YAML files."""
