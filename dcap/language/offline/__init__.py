"""The client that needs no model: a grammar, a lexicon in files, and choosers over both."""
