"""glTF 2.0: its document, its accessors, its scene."""
