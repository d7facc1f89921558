"""Contents of foreign files and the files that they name: JSON, pictures, companions."""
