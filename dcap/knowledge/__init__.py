"""What household things are: names, sizes, masses, parts, usual shapes and materials; used with and without a model."""
