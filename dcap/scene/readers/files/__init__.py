"""What foreign files are made of and name: JSON, pictures, companions."""
