"""Meaning of sentences and choices among what is listed: one seam, several clients, a lexicon in files."""
