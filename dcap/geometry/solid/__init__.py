"""Solids: from the faces of a scan to closed surfaces, and from those to particles."""
