"""The human study: its design, its votes and its results."""
