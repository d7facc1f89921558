"""Facts about household things: names, sizes, masses, parts, usual shapes and materials; with and without a model."""
