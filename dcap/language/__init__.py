"""The meaning of sentences, and choices among listed options: one interface, several clients, a lexicon in files."""
