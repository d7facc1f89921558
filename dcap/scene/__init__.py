"""The nouns of DCAP: frozen data types, their invariants, their file formats and the artifact store."""
