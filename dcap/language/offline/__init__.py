"""The client that needs no model: a grammar, a lexicon in files, and choices by both."""
